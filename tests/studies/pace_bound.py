# SPDX-License-Identifier: Apache-2.0
"""How fast a cycle of two stages could go straight on at most, if nothing but the actuators' speed and stroke held it up.

Quasi-static and linear about neutral lengths: a robot tips over an edge once its centre of mass is past it, and how far past each
strut takes it is its influence. So the least time of two rolls is a linear program in both stages' strokes a, b (mm) and times:

    min t1 + t2   with   |b - a| <= v t1,  |g a - b| <= v t2,  |a|, |b| <= limit,  s1 a >= d1,  s2 b >= d2

v: actuators' speed; g: relabels the cycle to its next two rolls; d: from the centre of mass to the edge in neutral; s: influences.
Falling takes no time, and no momentum helps: a robot that swings may need less of a stroke.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from sim_core.dynamics.footing import past_edges
from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.errors import DivergedError
from sim_core.gaits.cycle import NEXT_TC, TURNS, faces_of, turned
from sim_core.planning.floor_planner import Floor, Stance
from sim_core.structure.arrays import Array
from sim_core.structure.policy import neutral_lengths
from sim_core.structure.rotations import down_of
from sim_core.structure.symmetry import CARRIERS, REFERENCE_TC, REFERENCE_TO
from sim_core.structure.topology import FACES

STEP_M = 0.005
"""Change of a strut by which its influence is found."""
LONGEST_S, LOOK_STEPS = 20.0, 500


class PaceBound(NamedTuple):
    """Of going straight on by one turn.

    Attributes:
        turn: one of TURNS.
        two_rolls_s: least time of two rolls.
        m_per_min: straight way of two rolls, at rest in neutral, in that time.
    """

    turn: str
    two_rolls_s: float
    m_per_min: float


def pace_bounds(model: Model) -> tuple[PaceBound, ...]:
    """Of both turns. Takes some seconds."""
    rolls = ((REFERENCE_TC, REFERENCE_TO), (REFERENCE_TO, NEXT_TC))
    away_m, influence = zip(*(_edge(model, *roll) for roll in rolls), strict=True)
    return tuple(_bound(model, turn, away_m, influence) for turn in TURNS)


def _bound(model: Model, turn: str, away_m: tuple[float, ...], influence: tuple[Array, ...]) -> PaceBound:
    rule, one = model.prototype, np.eye(6)
    element = turned(CARRIERS[REFERENCE_TC, REFERENCE_TO], turn)
    onward = np.zeros((6, 6))
    onward[list(element.struts), range(6)] = 1.0
    none, time = np.zeros((6, 1)), np.full((6, 1), -1e3 * rule.actuator_speed_m_s)
    rows = [
        np.hstack(parts)
        for sign in (1.0, -1.0)
        for parts in ((-sign * one, sign * one, time, none), (sign * onward, -sign * one, none, time))
    ]
    rows += [np.append(-influence[0], np.zeros(8))[None], np.concatenate((np.zeros(6), -influence[1], np.zeros(2)))[None]]
    most = np.append(np.zeros(24), [-1e3 * away for away in away_m])
    limits = [(-rule.policy_limit_mm, rule.policy_limit_mm)] * 12 + [(0.0, None)] * 2
    found = linprog([0.0] * 12 + [1.0, 1.0], np.vstack(rows), most, bounds=limits)
    two_s = float(found.fun) if found.success else math.inf
    return PaceBound(turn, two_s, 60.0 * _straight_m(model, turn) / two_s)


def _straight_m(model: Model, turn: str) -> float:
    """Straight way of two rolls, of the twelve after which the robot stands on its first face again."""
    floor, stance = Floor(model), Stance(REFERENCE_TC, 0.0, 0.0, 0.0)
    for face in faces_of(REFERENCE_TC, REFERENCE_TO, (turn,) * 5)[1:]:
        stance = floor.rolled(stance, face)
    return stance.distance_m((0.0, 0.0)) / 6.0


def _edge(model: Model, source: str, target: str) -> tuple[float, Array]:
    """How far inside the edge of a roll the centre of mass is in neutral (m), and what takes it outwards: mm per mm, (6,)."""
    resting = Robot.resting_on(model, source)

    def past_m(strut: int, change_m: float) -> float:
        robot = resting.copy()
        lengths_m = neutral_lengths(model.prototype)
        lengths_m[strut] += change_m
        robot.set_targets(lengths_m)
        for _ in range(round(LONGEST_S * model.steps_per_second / LOOK_STEPS)):
            robot.advance(LOOK_STEPS)
            if robot.is_slow() and np.array_equal(robot.rest_lengths_m(), robot.targets_m()):
                return _past_m(robot, source, target)
        raise DivergedError(f"the robot does not come to rest within {LONGEST_S:g} s")

    slopes = [(past_m(strut, STEP_M) - past_m(strut, -STEP_M)) / (2.0 * STEP_M) for strut in range(6)]
    return -_past_m(resting, source, target), np.array(slopes)


def _past_m(robot: Robot, source: str, target: str) -> float:
    corners, most = np.array(FACES[source]), np.full(3, -np.inf)
    past_edges(robot.joints_m(), robot.center_of_mass_m(), down_of(robot.model.elements.gravity_m_s2), corners, most)
    edge = set(FACES[source]) & set(FACES[target])
    return float(next(most[i] for i in range(3) if {int(corners[i]), int(corners[(i + 1) % 3])} == edge))
