# SPDX-License-Identifier: Apache-2.0
"""Courses: rolls in a row, each of which goes on when it is time; the lanes do what one robot, stepped by hand, does."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from sim_core.dynamics import actuators as a
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.gaits.cycle import TURNS, Cycle, CycleStage, chain_of, faces_of
from sim_core.gaits.library import load_library
from sim_core.rolling.batch import FOLLOWING, Batch, Job
from sim_core.rolling.course import NEUTRAL, Course, Stage, stages_of_chain, stages_of_rolls
from sim_core.rolling.roll import rules_of, samples_of
from sim_core.rolling.roll_monitor import LOOK_SAMPLES, SAMPLE_S
from sim_core.structure.policy import lengths_of
from sim_core.uncertainty.perturbation_law import Law, sample

CYCLE = Cycle("C1", (CycleStage((7, 44, -19, -17, -45, -45), 0.1, 4.64), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.82)))
ROLL = load_library("robust").gaits("TC6", "TO5")[0].policy
STRENGTH = np.array([[1.1, 0.9, 1.0, 0.95, 1.05, 0.9], [0.92, 1.08, 0.97, 1.1, 0.9, 1.0]])
IDEAL, LOADED = None, a.load_actuators()


class Alone(NamedTuple):
    faces: list[str]
    landings: list[tuple[int, float, float]]
    driven: list[int]
    samples: int
    peak_n: float
    travel_m: tuple[float, float]


def seen(robot, stage, samples, faces):
    """The face that counts now; what it stands on joins `faces`."""
    strict = face = robot.footing().face
    if stage.least_s is not None:
        face = robot.face_under() if samples % LOOK_SAMPLES == 0 else None
    for one in (strict, face):
        if one is not None and one != faces[-1]:
            faces.append(one)
    return face


def alone(model, course, actuators=None, strength=1.0):
    """One robot, sample by sample, with the actuators' own `step`; goes on by what it sees of the robot."""
    e, reach = model.elements, model.elements.strut_gain * model.elements.strut_speed_m_s * SAMPLE_S
    if actuators is not None:
        quick = replace(e, strut_speed_m_s=np.full(6, FOLLOWING * actuators.no_load_speed_m_s))
        robot = Robot.resting_on(build_model(model.prototype, quick), course.source)
        state, told = a.at_rest(actuators, robot.rest_lengths_m(), robot.strut_forces_n()), robot.rest_lengths_m()
    else:
        robot = Robot.resting_on(model, course.source)
    robot.reset_peaks()
    start, faces, landings, driven, samples = robot.center_of_mass_m(), [course.source], [], np.zeros(6, int), 0
    for number, stage in enumerate(course.stages):
        goal = model.rest_lengths(lengths_of(model.prototype, stage.policy))
        quiet = 0
        landed = samples if number and course.stages[number - 1].onto == stage.onto else None
        while True:
            if actuators is not None:
                told = np.where(np.abs(goal - told) <= reach, goal, told + np.sign(goal - told) * reach)
                state = a.step(actuators, state, told, robot.strut_forces_n(), e.strut_mid_m, SAMPLE_S, strength)
                robot.set_raw_targets(a.lengths_m(actuators, state))
                driven += state.current_a > 0.0
            else:
                robot.set_raw_targets(goal)
            robot.advance(samples_of(model, SAMPLE_S))
            samples += 1
            if actuators is None:
                driven += robot.rest_lengths_m() != goal
            face = seen(robot, stage, samples, faces)
            if face == stage.onto and landed is None:
                landed = samples
                landings.append((samples, *robot.center_of_mass_m()[:2]))
            if stage.least_s is not None:
                if landed is not None and samples - landed >= round(stage.seen_s / SAMPLE_S):
                    break
            elif ((told if actuators is not None else robot.rest_lengths_m()) == goal).all():
                quiet = quiet + 1 if robot.is_slow() else 0
                if quiet >= rules_of(model).hold_samples:
                    break
    way = robot.center_of_mass_m() - start
    return Alone(faces, landings, driven.tolist(), samples, float(robot.peak_forces_n().max()), (float(way[0]), float(way[1])))


@pytest.fixture(scope="module")
def robots(model):
    return sample(model, Law(0.1), 2, 7)


def roll_stages(policy=ROLL, onto="TO5"):
    return Stage(policy, onto), Stage(NEUTRAL, onto)


def chain_stages(*turns, latency_s=0.4):
    return stages_of_chain(chain_of(CYCLE, faces_of("TC6", "TO5", turns)), latency_s)


@pytest.mark.parametrize("stages", [roll_stages(), chain_stages(TURNS[0])], ids=["roll", "chain"])
@pytest.mark.parametrize("actuators", [IDEAL, LOADED], ids=["ideal", "loaded"])
def test_a_course_in_the_lanes_is_the_robot_alone_to_the_last_bit(robots, stages, actuators):
    courses = [Course(number, "TC6", stages) for number in range(2)]
    for number, found in enumerate(Batch(robots, 1, actuators, STRENGTH).run(courses)):
        same = alone(robots[number], courses[number], actuators, STRENGTH[number])
        assert list(found.faces) == same.faces
        assert found.peak_force_n == same.peak_n
        assert found.travel_m == same.travel_m
        assert found.duration_s == same.samples * SAMPLE_S
        assert found.driven_s == tuple(count * SAMPLE_S for count in same.driven)
        if stages != roll_stages():  # a roll's landing is its rest
            (began, *first), (ended, *last) = same.landings[0], same.landings[-1]
            assert found.reached == found.wanted == len(same.landings)
            assert found.between_s == (ended - began) * SAMPLE_S
            assert found.pace_m_s == pytest.approx(np.hypot(*np.subtract(last, first)) / found.between_s, rel=1e-12)


class Records(Batch):
    """Gives what was watched, before it is judged."""

    def _judged(self, job, record, peaks, center):
        return record.tobytes(), peaks.tobytes(), center.tobytes()


def test_a_roll_is_a_course_of_two_stages_to_the_last_bit_of_the_record(robots):
    ways = [(ROLL, "TO5"), ((0, 30, 0, -30, 0, 10), "TO7")]
    rolls = [Job(number, "TC6", *way) for number in range(2) for way in ways]
    courses = [Course(number, "TC6", roll_stages(*way)) for number in range(2) for way in ways]
    rolls.append(Job(1, "TC6", ROLL + (0,) * 6, "TO5"))
    courses.append(Course(1, "TC6", stages_of_rolls([ROLL + (0,) * 6], ["TO5"], robots[1].prototype.actuator_speed_m_s)))
    batch = Records(robots, 1)
    assert batch.run(courses) == batch.run(rolls)


@pytest.fixture(scope="module")
def ends(model):
    """How courses end, by name, from one batch."""
    away = Stage(ROLL, "TO7", 0.0, 0.4, 9.0)
    courses = {
        "quick": chain_stages(),
        "slow": chain_stages(latency_s=3.0),
        "missed": (away, Stage(NEUTRAL, "TO7")),
        "limit": (Stage(NEUTRAL, "TO5", 0.0, 0.4, 1.0), Stage(NEUTRAL, "TO5")),
        "early": (Stage(ROLL, "TO5", 0.5), Stage(NEUTRAL, "TC3", 1.0)),
        "roll": roll_stages(),
        "one": (Stage(ROLL, "TO5", 0.0, 0.4, 9.0), Stage(NEUTRAL, "TO5")),
        "moving": (Stage(ROLL, "TO5", 0.0, 0.4, 9.0),),
    }
    found = Batch([model], 1).run([Course(0, "TC6", stages) for stages in courses.values()])
    return dict(zip(courses, found, strict=True))


def test_a_chain_waits_for_each_face_and_then_its_latency(ends):
    quick, slow = ends["quick"], ends["slow"]
    assert quick.faces == slow.faces == ("TC6", "TO5", "TC3")
    assert (quick.reached, quick.wanted, quick.ended) == (slow.reached, slow.wanted, slow.ended) == (2, 2, "TC3")
    assert slow.between_s - quick.between_s == pytest.approx(2.6, abs=0.5)  # from another attitude, so another roll


def test_another_face_than_the_next_ends_a_chain(ends):
    missed = ends["missed"]
    assert (missed.reached, missed.feasible, missed.ended) == (0, False, "")
    assert missed.reason == "on the way to TO7 it came to TO5"


def test_a_robot_that_does_not_land_within_the_limit_has_missed(ends):
    assert ends["limit"].reason == "on the way to TO5 it came to TC6"
    assert ends["limit"].duration_s == 1.0


def test_a_stage_by_time_whose_face_was_not_reached_leads_nowhere(ends):
    assert ends["early"].reason == "on the way to TO5 it came to TC6"
    assert ends["early"].duration_s == 0.5


def test_pace_needs_two_landings(ends):
    assert ends["one"].feasible
    assert (ends["one"].reached, ends["one"].between_s, ends["one"].pace_m_s) == (1, 0.0, 0.0)


def test_a_course_may_end_in_motion(ends):
    assert ends["moving"].feasible
    assert ends["moving"].duration_s < ends["one"].duration_s
    assert ends["moving"].ended == ""  # it was never at rest


def test_struts_are_driven_as_long_as_their_way_takes(ends, prototype):
    there_and_back_s = [2e-3 * abs(mm) / prototype.actuator_speed_m_s for mm in ROLL]
    assert ends["roll"].feasible
    assert ends["roll"].driven_s == pytest.approx(there_and_back_s, abs=2.1 * SAMPLE_S)


def test_a_course_that_does_not_come_to_rest_is_told(prototype):
    restless = build_model(replace(prototype, rest_hold_s=1.0, rest_timeout_s=0.5))
    found = Batch([restless], 1).run([Course(0, "TC6", (Stage(NEUTRAL, "TO5"),))])[0]
    assert found.reason == "not settled within 0.5 s at the end"
    assert (found.feasible, found.duration_s) == (False, 0.5)
