# SPDX-License-Identifier: Apache-2.0
"""Where to roll next, and when to give up: without ROS, with the robot's own floor."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.gaits.climb_limits import load_climbs
from sim_core.gaits.cycle import Chain, Cycle, CycleStage, Switches, turns_of
from sim_core.gaits.library import load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.planning.floor_planner import Floor, Stance
from sim_core.planning.journey import MOST_MISSES, Journey, JourneyEnd, Step, TravelRules
from sim_core.planning.keep_in import parsed_keep_in
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


def travelled(trip, stance, works=lambda step: True):
    """Roll as it says; a roll that does not work leaves the robot where it is. Its end, and the steps."""
    steps = []
    while isinstance(found := trip.look(stance), Step):
        steps.append(found)
        won = works(found)
        trip.rolled(found, int(won), not won)
        stance = found.way.stances[1] if won else stance
    return found, steps, stance


def test_it_arrives_and_tells_rolls_faces_and_lengths(floor, library):
    trip = journey(floor, library)
    end, steps, stance = travelled(trip, START)
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
    trip.rolled(first, 0, True)
    other = next(face for face in ("TO5", "TO7", "TO9") if face != first.gait.target)
    then = trip.look(floor.rolled(START, other))
    assert then.gait.source == other
    assert trip.missed == 1
    end, _, _ = travelled(trip, floor.rolled(START, other))
    assert end.success


def test_a_gait_that_misses_is_believed_less_and_another_way_is_taken(floor, library):
    trip = journey(floor, library)
    first = trip.look(START)
    bad = (first.gait.source, first.gait.target)
    end, steps, _ = travelled(trip, START, lambda step: (step.gait.source, step.gait.target) != bad)
    assert end.success
    tried = [step.gait.name for step in steps if (step.gait.source, step.gait.target) == bad]
    assert 1 <= len(tried) <= 4, "not the same vain roll for ever"


def test_it_gives_up_after_misses_in_a_row_and_says_so(floor, library):
    end, steps, _ = travelled(journey(floor, library), START, lambda step: False)
    assert not end.success
    assert len(steps) == MOST_MISSES
    assert f"the last {MOST_MISSES} rolls missed" in end.reason
    assert "cm from the goal" in end.reason


@pytest.mark.slow
def test_on_a_slope_it_arrives_for_all_its_misses_and_learns_where_downhill_is(floor, library):
    rng = np.random.default_rng(0)

    def works(step):
        heading = step.way.stances[0].heading_rad(step.way.stances[1])
        return rng.random() < 1.0 / (1.0 + math.exp(4.0 * math.cos(heading) - 2.0))  # straight uphill, along x: one of eight

    trip = journey(floor, library, (0.6, 0.0), most_rolls=100)
    end, _, _ = travelled(trip, START, works)
    assert end.success, end.reason
    assert trip.missed >= 6
    assert trip._experience.lean[0] < -2.0


def test_it_gives_up_after_the_rolls_that_were_asked_for(floor, library):
    end, steps, _ = travelled(journey(floor, library, (3.0, 0.0), most_rolls=3), START)
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
    trip.rolled(first, 0, True)
    then = trip.look(START)
    assert (then.gait.source, then.gait.target) == (first.gait.source, first.gait.target)
    assert then.gait.primitive.name != first.gait.primitive.name


def test_with_probabilities_the_first_gait_is_one_of_the_most_reliable_and_of_these_the_steepest_climber(floor, library):
    step = journey(floor, library).look(START)
    choices = FaceGraph(library, load_success_counts(library)).choices(step.gait.source, step.gait.target)
    surest = [choice.gait for choice in choices if choice.probability == choices[0].probability]
    assert step.gait == max(surest, key=load_climbs(library).of)


# ---- rolling on -----------------------------------------------------------------------------------------------------

COUNTED = {turn: Switches(1000, 998, 100, 100) for turn in ("TO4", "TO10")}
STAGES = CycleStage((7, 44, -19, -17, -45, -45), 0.0, 4.64), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.82)


@pytest.fixture
def cyclic(library):
    return replace(library, cycles=(Cycle("C1", STAGES, COUNTED),))


def rolled_on(trip, stance, longest, works=lambda faces: (len(faces) - 1, False)):
    """Roll as it says, `works` of a chain's faces: rolls that came onto theirs, and whether one missed then."""
    steps = []
    while isinstance(found := trip.look(stance, longest), Step):
        steps.append(found)
        faces = found.gait.faces if isinstance(found.gait, Chain) else (found.gait.source, found.gait.target)
        done, missed = works(faces)
        trip.rolled(found, done, missed)
        stance = found.way.stances[done]
    return found, steps, stance


def test_where_the_library_has_a_cycle_it_rolls_on_from_a_tc_to_the_goal(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    end, steps, _ = rolled_on(trip, START, 24)
    assert end.success
    assert isinstance(steps[0].gait, Chain)
    assert steps[0].gait.rolls, "a cycle goes there"
    assert trip.chained >= trip.rolls - 1 >= 12
    assert trip.rolls == len(trip.faces) - 1
    assert trip.path_m >= trip.straight_m - trip.left_m


@pytest.mark.parametrize("stray", [0.94, 1.06])
@pytest.mark.parametrize("angle_deg", [0, 75, 140, 250])
def test_a_robot_whose_chains_go_farther_or_less_far_looks_again_near_the_goal_and_hits_it(floor, stray, angle_deg):
    library, at = load_library("continuous"), math.radians(angle_deg)
    goal = math.cos(at), math.sin(at)
    trip = Journey(floor, library, load_success_counts(library), goal, TravelRules(0.08, 60))
    stance, legs = START, []
    while isinstance(found := trip.look(stance, 24), Step):
        rolls = len(found.gait.faces) - 1 if isinstance(found.gait, Chain) else 1
        legs.append(rolls)
        planned = found.way.stances[rolls]
        moved = stray if rolls > 1 else 1.0
        stance = planned._replace(
            x_m=stance.x_m + moved * (planned.x_m - stance.x_m), y_m=stance.y_m + moved * (planned.y_m - stance.y_m)
        )
        trip.rolled(found, rolls, False)
    assert found.success, found.reason
    assert legs[0] >= 10, "most of the way is one chain"
    assert sum(legs) <= 26
    assert len(legs) <= 4


def test_from_a_to_one_plain_roll_comes_first(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    _, steps, _ = rolled_on(trip, Stance("TO5", 0.0, 0.0, 0.0), 24)
    assert not isinstance(steps[0].gait, Chain)
    assert isinstance(steps[1].gait, Chain)


@pytest.mark.parametrize(("longest", "most"), [(0, 0), (1, 0), (5, 4), (8, 8)])
def test_a_chain_is_no_longer_than_what_is_permitted(floor, cyclic, longest, most):
    step = journey(floor, cyclic, (1.0, 0.2)).look(START, longest)
    assert (len(step.gait.faces) - 1 if isinstance(step.gait, Chain) else 0) == most


def test_the_rolls_that_were_asked_for_hold_for_chains_too(floor, cyclic):
    end, _, _ = rolled_on(trip := journey(floor, cyclic, (3.0, 0.0), most_rolls=7), START, 24)
    assert (end.success, trip.rolls) == (False, 7)


def test_a_chain_that_misses_counts_what_it_made(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    step = trip.look(START, 24)
    trip.rolled(step, 3, True)
    assert (trip.rolls, trip.chained, trip.missed) == (4, 4, 1)
    stance = step.way.stances[3]
    trip.look(stance, 24)
    assert trip.faces == [place.face for place in step.way.stances[:4]]


@pytest.mark.slow
def test_a_cycle_that_misses_again_and_again_is_believed_less_and_it_rolls_plainly(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    end, steps, _ = rolled_on(trip, START, 24, lambda faces: (0, True) if len(faces) > 2 else (1, False))
    assert end.success
    assert 1 <= trip.missed == sum(isinstance(step.gait, Chain) for step in steps) <= 3


def test_a_return_to_neutral_that_rolls_on_is_the_last_rolls_miss(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    step = trip.look(START, 4)
    trip.rolled(step, 4, True)
    assert (trip.rolls, trip.missed) == (4, 1)


def test_a_chain_that_ended_early_missed_nothing_and_one_that_made_no_roll_counts_as_refused(floor, cyclic):
    trip = journey(floor, cyclic, (1.0, 0.2))
    step = trip.look(START, 6)
    trip.rolled(step, 2, False)
    assert (trip.rolls, trip.missed, trip.refused) == (2, 0, 0)
    trip.rolled(step, 0, False)
    assert (trip.rolls, trip.missed, trip.refused) == (2, 0, 1)


def test_a_turn_that_often_misses_is_avoided_for_the_other_one(floor, cyclic):
    bad = replace(cyclic.cycles[0], turns=COUNTED | {"TO4": Switches(1000, 300, 100, 100)})
    step = journey(floor, replace(cyclic, cycles=(bad,)), (1.0, 0.2)).look(START, 24)
    assert "TO4" not in turns_of([place.face for place in step.way.stances[: step.way.on + 1]])
    assert step.way.probability > 0.4


@pytest.mark.parametrize(("longest", "low", "high"), [(0, -0.24, 0.3), (24, -0.13, 0.5)])
def test_a_way_stays_in_the_area(floor, cyclic, longest, low, high):
    area = parsed_keep_in(f"-0.3 {low}, 1.4 -0.3, 1.4 {high}, -0.3 {high}")
    trip = Journey(floor, cyclic, load_success_counts(cyclic), (0.8, 0.0), TravelRules(0.08, 40), area)
    step = trip.look(START, longest)
    free = journey(floor, cyclic, (0.8, 0.0)).look(START, longest)
    assert step.way.reaches
    assert max(area.outside_m(floor.joints_m(stance)) for stance in step.way.stances[1:]) <= 0.0
    assert max(area.outside_m(floor.joints_m(stance)) for stance in free.way.stances[1:]) > 0.0, "the test's own"


def test_from_outside_it_rolls_in(floor, library):
    area = parsed_keep_in("0.2 -1, 2 -1, 2 1, 0.2 1")
    trip = Journey(floor, library, load_success_counts(library), (0.8, 0.0), TravelRules(0.08, 40), area)
    assert trip.look(START).way.reaches
