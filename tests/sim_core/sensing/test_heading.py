# SPDX-License-Identifier: Apache-2.0
"""The robot's heading beside its twin's, by rates alone."""

import math

import numpy as np
import pytest

from sim_core.gaits.library import gait_of, load_library
from sim_core.sensing import face_filter as f
from sim_core.sensing.heading import Heading
from sim_core.structure.rotations import matrix_of
from tests.sensed_robot import SensedRobot


def turned(robot):
    """By how much the hidden robot's box has turned about the vertical beside the twin's, in rad."""
    apart = matrix_of(robot.robot.quaternions()[-1]) @ matrix_of(robot.twin.quaternions()[-1]).T
    return math.atan2(apart[1, 0] - apart[0, 1], apart[0, 0] + apart[1, 1])


@pytest.mark.parametrize("seed", [1, 3])
def test_after_some_rolls_it_knows_how_much_farther_the_robot_has_turned(model, seed):
    shelf, robot = load_library("robust"), SensedRobot(model, "TC6", seed)
    before = turned(robot)
    for source, target in (("TC6", "TO5"), ("TO5", "TC3"), ("TC3", "TO10")):
        primitive = next(p for p in shelf.primitives if p.roll_class.source[:2] == source[:2])
        assert robot.roll(gait_of(primitive, source, target).policy) == target
    truth = math.remainder(turned(robot) - before, 2.0 * math.pi)
    assert math.degrees(abs(math.remainder(robot.watch.heading.ahead_rad - truth, 2.0 * math.pi))) < 3.0


def test_what_was_found_stays_when_rates_were_missed_and_a_robot_that_turns_is_not_compared():
    heading, state, upright = Heading(), f.new_state(np.array([0.0, 0.0, 9.8])), np.array([1.0, 0.0, 0.0, 0.0])
    quarter = np.array([math.cos(math.pi / 4), 0.0, 0.0, -math.sin(math.pi / 4)])  # the twin turned clockwise
    heading.compare(state, np.array([0.0, 0.0, 1.0]), upright)
    assert math.isnan(heading.ahead_rad), "it turns"
    heading.compare(state, np.zeros(3), upright)
    assert heading.ahead_rad == 0.0
    heading.compare(state, np.zeros(3), quarter)
    assert heading.ahead_rad == pytest.approx(0.5 * math.pi)
    heading.begin_anew()
    heading.compare(state, np.zeros(3), upright)
    assert heading.ahead_rad == pytest.approx(0.5 * math.pi), "from here on it counts again"
    heading.compare(state, np.zeros(3), np.array([math.cos(0.2), math.sin(0.2), 0.0, 0.0]))
    assert heading.ahead_rad == pytest.approx(0.5 * math.pi), "a twin that is tipped is not compared"
