# SPDX-License-Identifier: Apache-2.0
"""Where to roll next, and when to give up: without ROS, with the robot's own floor."""

import math

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.gaits.climb_limits import load_climbs
from sim_core.gaits.library import load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.planning.floor_planner import Floor, Stance
from sim_core.planning.journey import MOST_MISSES, Journey, JourneyEnd, Step, TravelRules
from sim_core.structure.parameters import load_prototype

START = Stance("TC6", 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def floor():
    return Floor(build_model(load_prototype()))


@pytest.fixture(scope="module")
def library():
    return load_library("robust")


def journey(floor, library, goal=(0.4, 0.1), most_rolls=40, **more):
    return Journey(floor, library, load_success_counts(library), goal, TravelRules(0.08, most_rolls, **more))


def travelled(floor, trip, stance, works=lambda step: True):
    """Roll as it says; a roll that does not work leaves the robot where it is. Its end, and the steps."""
    steps = []
    while isinstance(found := trip.look(stance), Step):
        steps.append(found)
        won = works(found)
        trip.rolled(found, won)
        stance = floor.rolled(stance, found.gait.target) if won else stance
    return found, steps, stance


def test_it_arrives_and_tells_rolls_faces_and_lengths(floor, library):
    trip = journey(floor, library)
    end, steps, stance = travelled(floor, trip, START)
    assert end == JourneyEnd(True, end.reason)
    assert stance.distance_m((0.4, 0.1)) <= 0.08
    assert trip.rolls == len(steps) == len(trip.faces) - 1
    assert trip.faces == ["TC6", *(step.gait.target for step in steps)]
    assert trip.straight_m == pytest.approx(math.hypot(0.4, 0.1))
    assert trip.path_m >= trip.straight_m - trip.left_m
    assert trip.left_m == stance.distance_m((0.4, 0.1))


def test_at_the_goal_it_is_there(floor, library):
    assert journey(floor, library, (0.02, 0.0)).look(START).success


def test_a_roll_that_ends_elsewhere_is_replanned_from_there(floor, library):
    trip = journey(floor, library)
    first = trip.look(START)
    trip.rolled(first, False)
    other = next(face for face in ("TO5", "TO7", "TO9") if face != first.gait.target)
    then = trip.look(floor.rolled(START, other))
    assert then.gait.source == other
    assert trip.missed == 1
    end, _, _ = travelled(floor, trip, floor.rolled(START, other))
    assert end.success


def test_a_gait_that_misses_is_believed_less_and_another_way_is_taken(floor, library):
    trip = journey(floor, library)
    first = trip.look(START)
    bad = (first.gait.source, first.gait.target)
    end, steps, _ = travelled(floor, trip, START, lambda step: (step.gait.source, step.gait.target) != bad)
    assert end.success
    tried = [step.gait.name for step in steps if (step.gait.source, step.gait.target) == bad]
    assert 1 <= len(tried) <= 4, "not the same vain roll for ever"


def test_it_gives_up_after_misses_in_a_row_and_says_so(floor, library):
    end, steps, _ = travelled(floor, journey(floor, library), START, lambda step: False)
    assert not end.success
    assert len(steps) == MOST_MISSES
    assert f"the last {MOST_MISSES} rolls missed" in end.reason
    assert "cm from the goal" in end.reason


@pytest.mark.slow
def test_on_a_slope_it_arrives_for_all_its_misses_and_learns_where_downhill_is(floor, library):
    rng = np.random.default_rng(1)

    def works(step):
        heading = floor.heading_rad(step.way.stances[0], step.gait.target)
        return rng.random() < 1.0 / (1.0 + math.exp(4.0 * math.cos(heading) - 2.0))  # straight uphill, along x: one of eight

    trip = journey(floor, library, (0.6, 0.0), most_rolls=100)
    end, _, _ = travelled(floor, trip, START, works)
    assert end.success, end.reason
    assert trip.missed >= 6
    assert trip._experience.lean[0] < -2.0


def test_it_gives_up_after_the_rolls_that_were_asked_for(floor, library):
    end, steps, _ = travelled(floor, journey(floor, library, (3.0, 0.0), most_rolls=3), START)
    assert (end.success, len(steps)) == (False, 3)
    assert "most_rolls" in end.reason


def test_a_roll_that_the_planner_refuses_counts_as_evidence_but_not_as_a_roll(floor, library):
    trip = journey(floor, library)
    while isinstance(step := trip.look(START), Step):
        trip.refuse(step)
    assert not step.success
    assert (trip.rolls, trip.refused) == (0, MOST_MISSES)


def test_without_odds_all_gaits_are_alike_and_are_taken_in_turn(floor, library):
    trip = journey(floor, library, use_probabilities=False)
    first = trip.look(START)
    alike = {choice.probability for choice in trip._graph.choices("TC6", "TO5")}
    assert len(alike) == 1
    trip.rolled(first, False)
    then = trip.look(START)
    assert (then.gait.source, then.gait.target) == (first.gait.source, first.gait.target)
    assert then.gait.primitive.name != first.gait.primitive.name


def test_with_probabilities_the_first_gait_is_one_of_the_most_reliable_and_of_these_the_steepest_climber(floor, library):
    step = journey(floor, library).look(START)
    choices = FaceGraph(library, load_success_counts(library)).choices(step.gait.source, step.gait.target)
    surest = [choice.gait for choice in choices if choice.probability == choices[0].probability]
    assert step.gait == max(surest, key=load_climbs(library).of)
