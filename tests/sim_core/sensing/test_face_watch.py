# SPDX-License-Identifier: Apache-2.0
"""The face from an inertial sensor: what is said of hidden robots, and what is not said of faulty sensors."""

import math

import numpy as np
import pytest

from hardware_bridge.virtual_prototype.inertial_sensor import turned_about
from sim_core.gaits.cycle import TURNS, chain_of, faces_of
from sim_core.gaits.library import gait_of, load_library
from tests.benchmarks.imu.measure import words_and_faces
from tests.sensed_robot import SensedRobot


def gait(library, source, target):
    shelf = load_library(library)
    return gait_of(next(p for p in shelf.primitives if p.roll_class.source[:2] == source[:2]), source, target)


def rolled(robot, source, target, library="robust"):
    """One roll; the face on which it ends, and the words of it."""
    before = len(robot.words)
    face = robot.roll(gait(library, source, target).policy)
    return face, [word for _, word in robot.words[before:]]


@pytest.mark.parametrize(("library", "source", "target", "incline"), [("robust", "TC6", "TO5", 0.0), ("staged", "TC8", "TO7", 4.0)])
def test_a_roll_is_told_in_motion_and_at_rest(model, library, source, target, incline):
    robot = SensedRobot(model, source, seed=3, incline_deg=incline)
    face, words = rolled(robot, source, target, library)
    assert face == target
    assert [(word.face, word.settled) for word in words][-1] == (target, True)
    assert {word.face for word in words} <= {source, target}
    assert words[-1].detail.endswith("%")
    assert float(words[-1].detail.rstrip(" %")) >= 99.0


def test_a_roll_that_stays_where_it_is_is_told_as_that(model):
    robot = SensedRobot(model, "TC6", seed=3)
    assert robot.roll((5, -5, 5, -5, 5, -5)) == "TC6"
    assert (robot.words[-1][1].face, robot.words[-1][1].settled) == ("TC6", True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_chain_goes_on_by_its_word(model, seed):
    cycle, faces = load_library("continuous").cycles[0], faces_of("TC6", "TO5", (TURNS[0], TURNS[1], TURNS[0]))
    robot = SensedRobot(model, "TC6", seed)
    for roll in chain_of(cycle, faces):
        robot.drive(roll.policy, until=roll.onto)
        said_s, (stood_s, face) = robot.time_s, robot.faces[-1]
        robot.wait(0.2 + roll.dwell_s)
        assert robot.watch.known == roll.onto == robot.faces[-1][1]
        if face == roll.onto:
            assert said_s - stood_s <= 0.3
    robot.drive(None)
    robot.wait(2.0)
    assert robot.words[-1][1][:2] == (faces[-1], True) == (robot.robot.footing().face, True)


def test_a_sensor_that_stops_while_struts_move_makes_the_face_unknown_until_it_is_back(model):
    robot = SensedRobot(model, "TC6", seed=3)
    robot.spoil = lambda sample: None if 2.0 < sample[0] < 9.0 else sample
    face, words = rolled(robot, "TC6", "TO5")
    assert words[0][:2] == ("", False)
    assert "no measurement came for" in words[0].detail
    assert words[-1][:2] == (face, True)


def test_a_sensor_that_stopped_at_rest_makes_the_face_unknown_when_struts_move(model):
    robot = SensedRobot(model, "TC6", seed=3)
    robot.wait(2.0)
    assert robot.words[-1][1][:2] == ("TC6", True)
    robot.spoil = lambda sample: None
    robot.wait(2.0)
    assert robot.words[-1][1].face == "TC6", "nothing has moved"
    face, words = rolled(robot, "TC6", "TO5")
    assert face == "TO5"
    assert [word.face for word in words] == [""], "once"
    assert "no measurement came for" in words[0].detail


def test_a_sensor_that_lies_elsewhere_is_not_believed_when_struts_move(model):
    robot = SensedRobot(model, "TC6", seed=3)
    still = (np.zeros(3), robot.sensor.measure()[1])
    noise = np.random.default_rng(1)
    robot.spoil = lambda sample: (sample[0], still[0] + noise.normal(0, 0.003, 3), still[1] + noise.normal(0, 0.05, 3))
    assert rolled(robot, "TC6", "TO5")[0] == "TO5"
    robot.wait(3.0)
    assert robot.words[-1][1].face == ""
    assert "is it fixed to the box?" in robot.watch.doubt


def test_without_a_twin_or_with_a_clock_that_goes_back_nothing_is_told_and_then_again(model):
    robot = SensedRobot(model, "TC6", seed=3)
    robot.wait(1.0)
    assert robot.watch.unshaped() is None, "at rest what was known stays known"
    assert math.isnan(robot.watch.residual_rad)
    robot.wait(0.5)
    robot.watch.measured(robot.time_s - 100.0, *robot.sensor.measure())
    robot.spoil = lambda sample: (sample[0] - 100.0, *sample[1:])
    face, words = rolled(robot, "TC6", "TO5")
    assert words[-1][:2] == (face, True)


def test_a_sensor_that_repeats_itself_is_not_believed(model):
    robot, kept = SensedRobot(model, "TC6", seed=3), []

    def frozen(sample):
        kept.append(sample[1:])
        return (sample[0], *kept[0])

    robot.spoil = frozen
    face, words = rolled(robot, "TC6", "TO5")
    assert face == "TO5"
    assert [word.face for word in words] == [""]
    assert "the same figures again and again" in words[0].detail


def test_what_a_late_sensor_tells_of_before_the_motion_is_not_taken_for_after_it(model):
    robot, late = SensedRobot(model, "TC6", seed=3), []

    def two_seconds(sample):
        late.append(sample[1:])
        return (sample[0], *late[max(0, len(late) - 200)])

    robot.spoil = two_seconds
    began_s = robot.time_s
    face, _ = rolled(robot, "TC6", "TO5")
    assert face == "TO5"
    assert not [word for at, word in robot.words if word.settled and at > began_s + 1.0 and word.face != face]
    assert robot.watch.known == face, "told when it comes"


@pytest.mark.parametrize("at_s", [0.5, 2.5])
@pytest.mark.parametrize("seed", range(6))
def test_a_sensor_that_slips_at_rest_or_in_motion_states_no_wrong_face(model, seed, at_s):
    robot, rng = SensedRobot(model, "TC6", seed + 1), np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    turn = turned_about(axis / np.linalg.norm(axis), math.radians(rng.uniform(30.0, 90.0)))
    began_s = robot.time_s
    robot.spoil = lambda sample: (sample[0], turn @ sample[1], turn @ sample[2]) if sample[0] > began_s + at_s else sample
    face, _ = rolled(robot, "TC6", "TO5")
    robot.wait(1.0)
    assert words_and_faces(robot)[0] == 0, (robot.words, robot.faces)
    assert robot.watch.known in ("", face)
    assert robot.words[-1][1].face in ("", face), "silent is not an answer"


def test_a_robot_that_is_turned_by_hand_is_on_an_unknown_face_until_somebody_says_it(model):
    robot = SensedRobot(model, "TC6", seed=3, perturbation=0.0)
    quarter = turned_about(np.array([1.0, 0.0, 0.0]), math.radians(70.0))
    robot.spoil = lambda sample: (sample[0], sample[1], quarter @ sample[2]) if sample[0] > 1.5 else sample
    robot.wait(3.0)
    assert robot.words[-1][1][:2] == ("", False)
    robot.watch.said("TC6")
    assert robot.watch.doubt, "what it found before counts no more"
    robot.wait(1.0)
    assert robot.watch.doubt, "the sensor does not agree"
    robot.spoil = lambda sample: sample
    robot.wait(3.0)
    robot.watch.said("TC6")
    robot.wait(0.1)
    assert not robot.watch.doubt
