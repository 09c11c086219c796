# SPDX-License-Identifier: Apache-2.0
"""How much farther a robot has turned about the vertical than its twin predicts, by the rates of an inertial sensor.

Gravity does not tell it, so its error grows with time, by what is left of the rates' bias. That is learnt whenever the robot rests.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim_core.sensing.face_filter import AHEAD, BIAS, DOWN
from sim_core.structure.arrays import Array
from sim_core.structure.rotations import matrix_of

TILTED_RAD, TURNS_RAD_S = 0.1, 0.3
"""A twin that stands otherwise, or a robot that turns, is not compared: one of them tips before the other."""


@dataclass
class Heading:
    """Attributes: ahead_rad: counterclockwise seen from above; NaN: not known yet."""

    ahead_rad: float = math.nan
    _origin_rad: float | None = None

    def begin_anew(self) -> None:
        """Rates were missed: what was found stays, and counts from here."""
        self._origin_rad = None

    def compare(self, state: Array, rate_rad_s: Array, twin_quaternion: Array) -> None:
        """The filter's state, the newest rates of turn (3,), and the attitude (w, x, y, z) of the twin's box."""
        up = -state[DOWN : DOWN + 3]
        ahead = state[AHEAD : AHEAD + 3] - (state[AHEAD : AHEAD + 3] @ up) * up
        length = float(np.linalg.norm(ahead))
        if np.linalg.norm(rate_rad_s - state[BIAS : BIAS + 3]) > TURNS_RAD_S or length < 0.1:
            return
        ahead /= length
        turn = np.array((ahead, np.cross(up, ahead), up)) @ matrix_of(twin_quaternion).T
        if turn[2, 2] < math.cos(TILTED_RAD):
            return
        found_rad = math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
        if self._origin_rad is None:
            self.ahead_rad = 0.0 if math.isnan(self.ahead_rad) else self.ahead_rad
            self._origin_rad = found_rad - self.ahead_rad
        self.ahead_rad = math.remainder(found_rad - self._origin_rad, 2.0 * math.pi)
