# SPDX-License-Identifier: Apache-2.0
"""The twin as the robot, and when a robot rests."""

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.names import STRUT_NAMES
from sim_core.structure.parameters import load_prototype
from sim_core.twin.rest_detector import RestWatch
from sim_core.twin.standalone import StandAlone

S = 1_000_000_000
NEUTRAL = [0.234] * 6


@pytest.fixture(scope="module")
def model():
    return build_model(load_prototype())


def test_it_keeps_to_its_clock(model):
    alone = StandAlone(model, "TC6", time_scale=2.0)
    alone.run_until(5 * S)
    alone.run_until(5 * S + S // 10)
    assert alone.robot_time_ns == S // 5
    assert alone.skipped_s == 0.0


def test_a_machine_that_is_too_slow_loses_time_instead_of_piling_it_up(model):
    alone = StandAlone(model, "TC6", time_scale=1.0)
    alone.run_until(0)
    alone.run_until(10 * S, most_s=0.5)
    assert alone.robot_time_ns == S // 2
    assert alone.skipped_s == pytest.approx(9.5)
    alone.run_until(10 * S + S // 10, most_s=0.5)
    assert alone.robot_time_ns == pytest.approx(0.6 * S, abs=1e6)


def test_a_command_drives_the_struts_there(model):
    alone = StandAlone(model, "TC6", time_scale=1.0)
    alone.run_until(0)
    names = list(reversed(STRUT_NAMES))
    assert alone.command(names, [0.234, 0.234, 0.234, 0.234, 0.234, 0.230]) == ""
    for tenth in range(1, 6):
        alone.run_until(tenth * S // 10)
    assert alone.robot.rest_lengths_m() == pytest.approx([0.230, *NEUTRAL[1:]])


@pytest.mark.parametrize(
    ("names", "lengths", "why"),
    [
        (STRUT_NAMES, [*NEUTRAL[:5], 0.234 + 0.046], "S6: stroke 46 mm is outside the limit ±45 mm"),
        (STRUT_NAMES, [float("nan"), *NEUTRAL[1:]], "S1: stroke nan mm is outside the limit ±45 mm"),
        (STRUT_NAMES, NEUTRAL[:5], "with 5 positions"),
        (("S1",) * 6, NEUTRAL, "valid are S1 to S6"),
    ],
)
def test_a_command_is_refused_whole(model, names, lengths, why):
    alone = StandAlone(model, "TC6", time_scale=1.0)
    assert why in alone.command(names, lengths)
    assert np.array_equal(alone.robot.targets_m(), NEUTRAL)


def test_a_robot_rests_when_it_has_been_slow_for_the_hold_time_and_nothing_drives(model):
    alone, watch = StandAlone(model, "TC6", time_scale=1.0), RestWatch()
    robot = alone.robot
    most_of_hold = round(0.75 * model.prototype.rest_hold_s * model.steps_per_second)
    assert not watch.at_rest(robot, robot.step)
    robot.advance(most_of_hold)
    assert not watch.at_rest(robot, robot.step)
    robot.advance(most_of_hold)
    assert watch.at_rest(robot, robot.step)
    alone.command(STRUT_NAMES, [0.229, *NEUTRAL[1:]])
    assert not watch.at_rest(robot, robot.step)
    robot.advance(most_of_hold)
    assert not watch.at_rest(robot, robot.step)
