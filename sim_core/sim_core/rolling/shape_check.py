# SPDX-License-Identifier: Apache-2.0
"""The shape that six rest lengths give a robot that nothing touches, and whether a real one may take it.

A floating, weightless copy of the robot follows the lengths slowly, damped near critically, until it is at rest. What is judged is
that equilibrium: strut forces, slack tendons and gaps. A robot that tips over on the ground is `roll`'s business. Where a shape has
two equilibria, the one is judged that the robot comes to from the shape judged before, as the real robot would along a path.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import SETTLE_ZETA_1_S, Robot
from sim_core.errors import DivergedError, SimError
from sim_core.structure.arrays import Array
from sim_core.structure.elements import elements_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import STRUTS, TENDONS

MOST_SLACK = 6
"""A quarter of the tendons. The worst shipped primitive has 2; short of a collapse they go slack one by one, then all at once."""
JUMP_SPEED_M_S, FOLLOW_SPEED_M_S = 0.1, 0.03
"""Of the struts on the way to a shape that is far, and along a path."""
NEAR_M = 0.003
"""No strut has to go farther: a shape along a path."""
REST_SPEED_M_S = 0.003
"""Every joint slower than this is at rest: forces are then within 1 N of those at full rest."""
FOLLOWS_M_S = 0.04
"""Every joint slower than this only follows struts that go along a path: forces are then within MARGIN_N of those at full rest."""
MARGIN_N, MARGIN_M, MARGIN_SLACK = 4.0, 0.001, 3
"""A shape that is so near to a limit is judged at rest."""
LONGEST_S = 4.0
SLACK_N = 0.01
"""A tendon that pulls less hangs."""
CHUNK_STEPS = 40
HEIGHT_M = 10.0
"""Of the floating robot; far from the ground, at z = 0."""


@dataclass(frozen=True)
class ShapeLimits:
    """What a shape may ask of the structure.

    Attributes:
        force_n: largest axial force of a strut, either way.
        slack: most tendons that may hang.
        clearance_m: smallest gap between surfaces of struts, or of a strut and the box.
    """

    force_n: float
    slack: int
    clearance_m: float

    @classmethod
    def of(cls, prototype: Prototype, slack: int = MOST_SLACK) -> ShapeLimits:
        """Force and clearance as rolls of this prototype are judged by."""
        return cls(prototype.force_fraction * prototype.actuator_stall_n, slack, prototype.clearance_margin_m)


@dataclass(frozen=True)
class Shape:
    """One equilibrium: strut forces (6,) N, tension positive; slack tendons, from 1; smallest gap m; joints (12, 3) m."""

    forces_n: Array
    slack: tuple[int, ...]
    clearance_m: float
    joints_m: Array


class ShapeJudge:
    """Judges six rest lengths; the nearer they are to those judged before, the faster (1 mm on: about 1 ms).

    May be called from any thread; holds the interpreter for less than a millisecond at a time.
    """

    def __init__(self, prototype: Prototype, limits: ShapeLimits | None = None):
        """Raises ModelError, UnstableStepError: the prototype makes no robot."""
        floating = replace(elements_of(prototype), gravity_m_s2=np.zeros(3), zeta_1_s=SETTLE_ZETA_1_S)
        self.limits = ShapeLimits.of(prototype) if limits is None else limits
        self._jumping, self._following = (
            build_model(prototype, replace(floating, strut_speed_m_s=np.full(6, speed)))
            for speed in (JUMP_SPEED_M_S, FOLLOW_SPEED_M_S)
        )
        self._robot = self._neutral()
        self._lock = threading.Lock()

    def __call__(self, lengths_m: Sequence[float]) -> str | None:
        """What is wrong with the shape, in one line naming strut or tendons, value and limit; None: nothing.

        Args:
            lengths_m: six absolute rest lengths.
        """
        verdict = self.verdict(lengths_m)
        return verdict if isinstance(verdict, str) else None

    def verdict(self, lengths_m: Sequence[float]) -> str | tuple[float, ...]:
        """What is wrong with the shape; or the axial forces of the six struts, in N, tension positive: nothing is."""
        with self._lock:
            try:
                shape = self._followed(lengths_m)
                problem = self._problem(shape)
            except SimError as error:
                problem = str(error)
            if problem is not None:
                self._robot = self._neutral()  # what has collapsed may come back in a knot
                return problem
            return tuple(shape.forces_n.tolist())

    def shape(self, lengths_m: Sequence[float]) -> Shape:
        """The equilibrium at six absolute rest lengths. Raises DivergedError: there is none."""
        with self._lock:
            return self._come_to(lengths_m, REST_SPEED_M_S)

    def _neutral(self) -> Robot:
        robot = Robot(self._jumping)
        robot.place(np.eye(3), np.array([0.0, 0.0, HEIGHT_M]))
        return robot

    def _followed(self, lengths_m: Sequence[float]) -> Shape:
        """The shape as near to its equilibrium as its verdict needs."""
        shape = self._come_to(lengths_m, FOLLOWS_M_S)
        limits, largest_n = self.limits, float(np.abs(shape.forces_n).max())
        few = len(shape.slack) + MARGIN_SLACK <= limits.slack
        if largest_n < limits.force_n - MARGIN_N and few and shape.clearance_m > limits.clearance_m + MARGIN_M:
            return shape
        return self._come_to(lengths_m, REST_SPEED_M_S)

    def _come_to(self, lengths_m: Sequence[float], slow_m_s: float) -> Shape:
        """Follow to six lengths until every joint is slower; from far until the robot is at rest."""
        robot, model = self._robot, self._following
        robot.set_targets(np.asarray(lengths_m, dtype=float))
        if np.abs(robot.targets_m() - robot.rest_lengths_m()).max() > NEAR_M:
            model, slow_m_s = self._jumping, REST_SPEED_M_S
        robot.model = model
        for _ in range(round(LONGEST_S * model.steps_per_second / CHUNK_STEPS)):
            robot.advance(CHUNK_STEPS)
            time.sleep(0)  # compiled steps hold the interpreter: let whoever waits for it go first
            there = np.array_equal(robot.rest_lengths_m(), robot.targets_m())
            if there and robot.joint_speeds_m_s().max() < slow_m_s:
                break
        else:
            raise DivergedError(f"the structure does not come to rest within {LONGEST_S:g} s at these lengths")
        tensions = robot.cable_forces_n()[: len(TENDONS)]
        slack = tuple(int(tendon) + 1 for tendon in np.flatnonzero(tensions < SLACK_N))
        return Shape(robot.strut_forces_n(), slack, robot.clearance_m(), robot.joints_m())

    def _problem(self, shape: Shape) -> str | None:
        limits, strut = self.limits, int(np.argmax(np.abs(shape.forces_n)))
        if abs(shape.forces_n[strut]) > limits.force_n:
            return f"S{strut + 1}: force {shape.forces_n[strut]:.1f} N is outside the limit ±{limits.force_n:.1f} N"
        if len(shape.slack) > limits.slack:
            names = ", ".join(f"T{tendon}" for tendon in shape.slack)
            return f"{len(shape.slack)} tendons are slack ({names}), the limit is {limits.slack}"
        if shape.clearance_m < limits.clearance_m:
            gap_mm, limit_mm = 1e3 * shape.clearance_m, 1e3 * limits.clearance_m
            return (
                f"{_nearest(shape.joints_m)}: gap {gap_mm:.1f} mm is below the limit {limit_mm:.1f} mm (struts, or strut and box)"
            )
        return None


def _nearest(joints_m: Array) -> str:
    """The two struts that come nearest to each other, to name them: found among points along them."""
    along = np.linspace(0.0, 1.0, 41)[:, None]
    lines = [joints_m[first] + along * (joints_m[second] - joints_m[first]) for first, second in STRUTS]

    def gap(pair: tuple[int, int]) -> float:
        one, other = lines[pair[0]], lines[pair[1]]
        return float(np.linalg.norm(one[:, None] - other[None], axis=2).min())

    first, second = min(combinations(range(len(STRUTS)), 2), key=gap)
    return f"S{first + 1} and S{second + 1}"
