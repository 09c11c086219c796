# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from hardware_bridge.virtual_prototype.inertial_sensor import (
    GRAVITY_M_S2,
    MOUNTED_OFF_RAD,
    RANGE_M_S2,
    RATE_BIAS_RAD_S,
    InertialSensor,
)
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.parameters import load_prototype
from sim_core.structure.rotations import matrix_of


@pytest.fixture
def robot():
    return Robot.resting_on(build_model(load_prototype()), "TC6")


def measured(sensor, robot, samples, steps=2):
    found = []
    for _ in range(samples):
        robot.advance(steps)
        found.append(sensor.measure())
    return np.array(found)


def test_at_rest_it_feels_up_and_its_bias(robot):
    sensor = InertialSensor(robot, seed=4)
    rates, felt = measured(sensor, robot, 200).mean(axis=0)
    up = (matrix_of(robot.quaternions()[-1]) @ sensor.mounting).T @ np.array([0.0, 0.0, GRAVITY_M_S2])
    assert np.abs(felt - up).max() < 0.05
    assert 0.0 < np.abs(rates).max() <= RATE_BIAS_RAD_S + 0.001


def test_it_is_mounted_askew_by_its_seed_alone(robot):
    one, same, other = (InertialSensor(robot, seed) for seed in (4, 4, 5))
    assert np.array_equal(one.mounting, same.mounting)
    assert not np.allclose(one.mounting, other.mounting)
    assert math.acos((np.trace(one.mounting) - 1.0) / 2.0) == pytest.approx(MOUNTED_OFF_RAD)


def test_rates_add_up_to_the_turn_and_a_bump_saturates(robot):
    sensor = InertialSensor(robot, seed=4, mounted_off_rad=0.0)
    calm = measured(sensor, robot, 100, steps=1)[:, 0].mean(axis=0)
    before = matrix_of(robot.quaternions()[-1])
    push = np.zeros((robot.model.assembly.particles, 3))
    push[:12, 0] = 0.4
    robot.push(push)
    seconds = robot.model.dt_s
    turn = np.eye(3)
    felt = []
    for _ in range(300):
        robot.advance(1)
        rate, acceleration = sensor.measure()
        x, y, z = (rate - calm) * seconds
        turn = turn @ (np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
        felt.append(acceleration)
    went = before.T @ matrix_of(robot.quaternions()[-1])
    assert np.abs(turn - went).max() < 0.02
    assert np.abs(felt).max() <= RANGE_M_S2


def test_one_that_slips_feels_up_elsewhere(robot):
    sensor = InertialSensor(robot, seed=4)
    before = measured(sensor, robot, 50)[:, 1].mean(axis=0)
    sensor.turn(math.radians(60.0))
    after = measured(sensor, robot, 50)[:, 1].mean(axis=0)
    assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before), rel=0.02)
    assert np.linalg.norm(after - before) > 1.0
