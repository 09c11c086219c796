# SPDX-License-Identifier: Apache-2.0
"""A twin that is the robot itself, on its own clock. Knows no ROS."""

import math
from collections.abc import Sequence

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.errors import brief
from sim_core.names import STRUT_NAMES


class StandAlone:
    """A robot that runs by the steady clock.

    Attributes:
        robot: the robot.
        skipped_s: robot time that the machine was too slow for.
    """

    def __init__(self, model: Model, face: str, time_scale: float):
        """At rest on `face`; `time_scale` robot seconds a second. Raises UnknownFaceError."""
        self.robot = Robot.resting_on(model, face)
        self.time_scale = time_scale
        self.skipped_s = 0.0
        self._begin_ns: int | None = None

    @property
    def robot_time_ns(self) -> int:
        """Robot time of the state."""
        return self.robot.step * 1_000_000_000 // self.robot.model.steps_per_second

    def run_until(self, steady_ns: int, most_s: float = 0.5) -> None:
        """Step to where the steady clock is, but at most `most_s` of robot time; what is beyond is skipped, not made up for."""
        if self._begin_ns is None:
            self._begin_ns = steady_ns
        due_s = (steady_ns - self._begin_ns) * 1e-9 * self.time_scale - self.skipped_s
        steps = math.floor(due_s * self.robot.model.steps_per_second) - self.robot.step
        most = round(most_s * self.robot.model.steps_per_second)
        if steps > most:
            self.skipped_s += (steps - most) / self.robot.model.steps_per_second
            steps = most
        if steps > 0:
            self.robot.advance(steps)

    def command(self, names: Sequence[str], lengths_m: Sequence[float]) -> str:
        """Drive to rest lengths (m); returns why not, or nothing. A command is refused whole."""
        if sorted(names) != list(STRUT_NAMES) or len(lengths_m) != len(names):
            return f"names are {brief(list(names[:7]))} with {len(lengths_m)} positions; valid are S1 to S6, each once"
        prototype = self.robot.model.prototype
        limit_mm = float(prototype.policy_limit_mm)
        target = np.empty(6)
        for name, length in zip(names, lengths_m, strict=True):
            stroke_mm = (length - prototype.strut_length_m) * 1e3
            if not abs(stroke_mm) <= limit_mm + 1e-6:  # also not-a-number
                return f"{name}: stroke {stroke_mm:.4g} mm is outside the limit ±{limit_mm:g} mm"
            target[STRUT_NAMES.index(name)] = length
        self.robot.set_targets(target)
        return ""
