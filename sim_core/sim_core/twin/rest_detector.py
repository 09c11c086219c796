# SPDX-License-Identifier: Apache-2.0
"""When a robot is at rest: the one definition, and its hold times. Knows no ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sim_core.dynamics.robot import Robot


# A model, rolled or followed, is at rest after `rest_hold_s` of its prototype's parameters. Who only looks on has these:
OBSERVER_HOLD_S = 0.2
"""Robot time for which an observer's joints must be slow: it sees no actuators, and orders wait for its word."""
STRUTS_HOLD_S = 0.5
"""Robot time for which a strut must not have moved before it is said to have stalled: under load it only goes slowly."""


class RestWatch:
    """Looks at a robot again and again. At rest: no actuator drives, and every joint has been slow for the hold time."""

    def __init__(self, hold_s: float | None = None, sees_drives: bool = True, resting: bool = False) -> None:
        """Nothing was seen yet; `resting`: it rests now. `hold_s`: how long it must be slow; None: the model's."""
        self._hold_s, self._sees_drives = hold_s, sees_drives
        self._quiet_since = -np.inf if resting else None

    def at_rest(self, robot: Robot, step: int) -> bool:
        """Look at the robot, which is at `step` (never less than before); whether it is at rest."""
        driving = self._sees_drives and not np.array_equal(robot.rest_lengths_m(), robot.targets_m())
        if driving or not robot.is_slow():
            self._quiet_since = None
            return False
        if self._quiet_since is None:
            self._quiet_since = step
        hold_s = robot.model.prototype.rest_hold_s if self._hold_s is None else self._hold_s
        return bool(step - self._quiet_since >= hold_s * robot.model.steps_per_second)
