# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from hardware_bridge.virtual_prototype.inertial_sensor import InertialSensor
from sim_core.dynamics.robot import Robot
from sim_core.errors import ParameterError
from sim_core.sensing.mounting import found_mounting
from sim_core.uncertainty.perturbation_law import perturb
from tests.sensed_robot import box_share

FACES = ("TC6", "TO5", "TC3", "TO10", "TC1", "TO2")


def felt_by(model, seed, faces=FACES):
    """Mean accelerations on each face, and the true mounting."""
    felt, mounting = {}, np.eye(3)
    for face in faces:
        robot = Robot.resting_on(perturb(model, 0.1, seed), face)
        sensor = InertialSensor(robot, seed)
        robot.advance(2)
        felt[face], mounting = np.mean([sensor.measure()[1] for _ in range(50)], axis=0), sensor.mounting
    return felt, mounting


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_it_is_found_within_little_more_than_a_degree(model, seed):
    felt, mounting = felt_by(model, seed)
    found = found_mounting(model, felt, box_share(model))
    angle = math.acos(min(1.0, (np.trace(found.rotation @ mounting.T) - 1.0) / 2.0))
    assert angle < math.radians(1.2)
    assert max(found.off_rad.values()) < math.radians(2.0)
    assert set(found.off_rad) == set(FACES)


def test_faces_that_do_not_fit_and_too_few_of_them_are_refused(model):
    felt, _ = felt_by(model, 1)
    with pytest.raises(ParameterError, match=r"do not fit together: T[CO]\d+ is off by"):
        found_mounting(model, felt | {"TO5": felt["TO10"], "TO10": felt["TO5"]}, box_share(model))
    for few in (("TC6", "TC3", "TC1"), ("TC6", "TO5")):
        with pytest.raises(ParameterError, match="at least one of them a TO"):
            found_mounting(model, {face: felt[face] for face in few}, box_share(model))
