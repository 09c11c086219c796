# SPDX-License-Identifier: Apache-2.0
"""Where the robot is by the twin, as soon as a sensor tells its heading: what it rolls from then on leads there."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseArray
from rclpy.clock import Clock

from tensegrity_interfaces.msg import FaceEstimate
from tensegrity_robot.planner.told_joints import ToldJoints

SHAPE = np.random.default_rng(0).normal(0.0, 0.1, (12, 3))


@pytest.fixture
def told():
    clock = Clock()
    node = SimpleNamespace(get_clock=lambda: clock, create_subscription=lambda *given, **more: None)
    told = ToldJoints(node)  # what it hears is given to it here

    def at(x, y):
        poses = [Pose(position=Point(x=float(p[0] + x), y=float(p[1] + y), z=float(p[2]))) for p in SHAPE - SHAPE.mean(axis=0)]
        message = PoseArray(poses=poses)
        message.header.stamp = clock.now().to_msg()
        told.predict(message)
        return told.newest(watched=False)

    def ahead(angle_rad):
        message = FaceEstimate(ahead_rad=angle_rad)
        message.header.stamp = clock.now().to_msg()
        told.feel(message)

    return SimpleNamespace(at=at, ahead=ahead)


def test_without_a_sensor_it_is_where_the_twin_has_it(told):
    told.ahead(math.nan)
    assert told.at(1.0, 0.5).mean(axis=0)[:2] == pytest.approx([1.0, 0.5])


def test_the_robot_turns_on_the_spot_and_goes_on_in_its_own_heading(told):
    told.at(1.0, 0.0)
    told.ahead(0.5 * math.pi)
    joints = told.at(1.0, 0.0)
    assert joints.mean(axis=0)[:2] == pytest.approx([1.0, 0.0]), "what it rolled before stays"
    assert told.at(2.0, 0.0).mean(axis=0)[:2] == pytest.approx([1.0, 1.0])
    told.ahead(0.0)
    told.at(2.0, 0.0)
    assert told.at(3.0, 0.0).mean(axis=0)[:2] == pytest.approx([2.0, 1.0])
    assert np.linalg.norm(joints[0] - joints[1]) == pytest.approx(np.linalg.norm(SHAPE[0] - SHAPE[1]))
