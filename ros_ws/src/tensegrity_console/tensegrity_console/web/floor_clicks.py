# SPDX-License-Identifier: Apache-2.0
"""The floor under the robot: where each neighbouring face would lie, what a click means, where a roll would take it."""

from functools import cache
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.planning.floor_planner import Floor, Stance
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import FACES, NEIGHBOURS
from tensegrity_console.web.state import Facts, Selection

FARTHEST_M = 20.0
"""Of a travel's goal."""


class Neighbour(NamedTuple):
    """A face that one roll reaches: its name, and its triangle on the floor, (3, 2)."""

    face: str
    corners_m: Array


class Ground:
    """The nominal robot at rest, for drawing and for clicks."""

    def __init__(self, model: Model | None = None):
        """Settles a robot twice; takes some tenths of a second once the solver is compiled."""
        model = model or build_model(load_prototype())
        self._floor = Floor(model)
        self._heights_m = cache(lambda face: Robot.resting_on(model, face).joints_m()[:, 2])

    def stance(self, facts: Facts) -> Stance | None:
        """Where the robot stands; None: on no face that is known, or not heard of yet."""
        if not facts.face or facts.face not in FACES or len(facts.joints_m) < 12:
            return None
        return self._floor.stance(facts.face, facts.joints_m[:12])

    def neighbours(self, stance: Stance) -> list[Neighbour]:
        """The three faces that a roll may reach."""
        there = {target: self._floor.joints_m(self._floor.rolled(stance, target)) for target in NEIGHBOURS[stance.face]}
        return [Neighbour(target, joints_m[list(FACES[target])]) for target, joints_m in there.items()]

    def clicked(self, facts: Facts, origin: Array, direction: Array) -> Selection:
        """What a ray of sight meets on the floor: a neighbouring face, or a place. Above the horizon, and too far away: nothing."""
        if not (np.isfinite(origin).all() and np.isfinite(direction).all()) or direction[2] >= -1e-6:
            return Selection()
        x, y, _ = origin - direction * (origin[2] / direction[2])
        if not np.hypot(x, y) <= FARTHEST_M:
            return Selection()
        place = (round(float(x), 3), round(float(y), 3))
        stance = self.stance(facts)
        for neighbour in self.neighbours(stance) if stance is not None else ():
            if _inside(np.array(place), neighbour.corners_m):
                return Selection(neighbour.face, stood=facts.face)
        return Selection("", place, facts.face)

    def ghost_m(self, stance: Stance, end: str) -> Array | None:
        """Joints of the robot at rest on another face after a roll, (12, 3); None: it is no neighbour of this one."""
        if end == stance.face:
            there = stance
        elif end in NEIGHBOURS[stance.face]:
            there = self._floor.rolled(stance, end)
        else:
            return None
        return np.column_stack([self._floor.joints_m(there), self._heights_m(end)])


def _inside(point: Array, corners: Array) -> bool:
    """Whether a point is inside a triangle, (3, 2)."""
    edges = np.roll(corners, -1, axis=0) - corners
    off = point - corners
    sides = edges[:, 0] * off[:, 1] - edges[:, 1] * off[:, 0]
    return bool((sides >= 0.0).all() or (sides <= 0.0).all())
