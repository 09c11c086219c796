# SPDX-License-Identifier: Apache-2.0
"""When a followed robot is at rest. Knows no ROS."""

from __future__ import annotations

import numpy as np

from sim_core.dynamics.robot import Robot


class RestWatch:
    """Looks at a robot after every event.

    At rest, as in a roll's judgement: no actuator drives, and every joint has been slow for the hold time.
    """

    def __init__(self) -> None:
        self._quiet_since: int | None = None

    def at_rest(self, robot: Robot, step: int) -> bool:
        """Look at the robot, which is at `step` (never less than before); whether it is at rest."""
        driving = not np.array_equal(robot.rest_lengths_m(), robot.targets_m())
        if driving or not robot.is_slow():
            self._quiet_since = None
            return False
        if self._quiet_since is None:
            self._quiet_since = step
        return step - self._quiet_since >= robot.model.prototype.rest_hold_s * robot.model.steps_per_second
