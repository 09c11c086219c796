# SPDX-License-Identifier: Apache-2.0
"""The inertial sensor in the virtual prototype's box: what it would measure, with its errors. Drawn here and told to nobody."""

import math

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.imu.wt901 import GRAVITY_M_S2
from sim_core.dynamics import vfife as k
from sim_core.dynamics.robot import Robot
from sim_core.structure.rotations import matrix_of, relative_quaternion, unit

MOUNTED_OFF_RAD = math.radians(5.0)
RATE_BIAS_RAD_S = math.radians(0.5)
RATE_NOISE_RAD_S = math.radians(0.2)
ACCELERATION_NOISE_M_S2 = 0.01 * GRAVITY_M_S2
"""Stand-in figures of a cheap sensor; the bias of each axis is drawn up to its own."""
RANGE_M_S2 = 4.0 * GRAVITY_M_S2
"""Where accelerations saturate: a bump at landing is beyond."""


class InertialSensor:
    """Fixed to the box, turned against it by a mounting of its own.

    Attributes:
        mounting: rotation from the sensor's frame to the box's, (3, 3); never told.
    """

    def __init__(self, robot: Robot, seed: int, mounted_off_rad: float = MOUNTED_OFF_RAD) -> None:
        self._robot = robot
        self._rng = np.random.default_rng([seed, 2])
        self.mounting = turned_about(unit(self._rng.standard_normal(3)), mounted_off_rad)
        self._bias = RATE_BIAS_RAD_S * self._rng.uniform(-1.0, 1.0, 3)
        self._step, self._velocity, self._attitude = robot.step, self._box(k.V), self._box(k.Q, 4)

    def turn(self, angle_rad: float) -> None:
        """It slips in its mount, about a level axis that is drawn: a turn about the vertical shows nowhere."""
        up = -matrix_of(self._box(k.Q, 4)).T @ self._robot.model.elements.gravity_m_s2
        self.mounting = turned_about(unit(np.cross(up, self._rng.standard_normal(3))), angle_rad) @ self.mounting

    def measure(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean rate of turn (rad/s) and acceleration (m/s², up at rest) since the last call, in the sensor's axes, (3,) each."""
        robot, model = self._robot, self._robot.model
        velocity, attitude, seconds = self._box(k.V), self._box(k.Q, 4), (robot.step - self._step) * model.dt_s
        gained, turned = np.zeros(3), np.zeros(3)
        if seconds > 0.0:
            gained = (velocity - self._velocity) / seconds
            w, *axis = relative_quaternion(self._attitude, attitude)
            turned = 2.0 * np.sign(w) * np.array(axis) / seconds
        self._step, self._velocity, self._attitude = robot.step, velocity, attitude
        axes = matrix_of(attitude) @ self.mounting
        rate = self.mounting.T @ turned + self._bias + RATE_NOISE_RAD_S * self._rng.standard_normal(3)
        felt = axes.T @ (gained - model.elements.gravity_m_s2) + ACCELERATION_NOISE_M_S2 * self._rng.standard_normal(3)
        return rate, np.clip(felt, -RANGE_M_S2, RANGE_M_S2)

    def _box(self, row: int, rows: int = 3) -> NDArray[np.float64]:
        start = (self._robot.model.assembly.particles - 1) * k.PARTICLE_ROWS + row
        return self._robot.arrays()[0][start : start + rows].copy()


def turned_about(axis: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """Rotation matrix about a unit vector, (3,)."""
    half = 0.5 * angle_rad
    return np.asarray(matrix_of(np.append(math.cos(half), math.sin(half) * axis)))
