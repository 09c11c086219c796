# SPDX-License-Identifier: Apache-2.0
"""What is tried, in which order, and how long it takes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_core.gaits.library import load_library
from sim_core.planning.face_graph import FaceGraph
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.plan import (
    chosen_gaits,
    chosen_primitives,
    due_of,
    next_due,
    placing,
    plan_of,
    plan_text,
    way_to_due,
)
from tensegrity_lab.trials.time_estimate import HANDS, Pace, estimate, work_of
from tests.scale import examples
from tests.tensegrity_lab.trials.sessions import planned

LIBRARY = load_library()
REAL = Pace(0.015, 1.0, *HANDS)


def test_forty_primitives_in_24_gaits_are_960_trials_each_once():
    plan = planned("1-40")
    assert len(plan) == len({slot.gait for slot in plan}) == 960
    assert sum(slot.proper for slot in plan) == 480


def test_the_seed_draws_the_order_and_nothing_else():
    assert planned(seed=4) == planned(seed=4)
    assert planned(seed=4) != planned(seed=5)
    assert sorted(planned(seed=4)) == sorted(planned(seed=5))


def test_a_plan_reads_back_from_its_table():
    plan = planned(repeats=2)
    again = plan_of(plan_text(plan), "here")
    assert [slot._replace(odds=0) for slot in again] == [slot._replace(odds=0) for slot in plan]
    older = plan_text(plan).replace("true", "True").replace("false", "False")
    assert plan_of(older, "here") == again


@pytest.mark.parametrize(("words", "names"), [("1-3", "P1 P2 P3"), ("2,P5,2", "P2 P5"), ("40", "P40"), ("1-2, 4", "P1 P2 P4")])
def test_primitives_go_by_number_range_or_name(words, names):
    assert [p.name for p in chosen_primitives(LIBRARY, words)] == names.split()


@pytest.mark.parametrize("words", ["0", "41", "3-1", "P99", "", "1-"])
def test_a_primitive_that_is_not_there_is_refused_with_what_is(words):
    with pytest.raises(SessionError, match="valid are numbers 1 to 40, ranges such as 1-40, all, and names: P1, P2"):
        chosen_primitives(LIBRARY, words)


def test_gaits_are_all_a_half_the_reference_or_pairs():
    chosen = chosen_primitives(LIBRARY, "1-40")
    assert {word: len(chosen_gaits(chosen, word)) for word in ("all", "proper", "improper", "reference", "TC6-TO5,TO5-TC6")} == {
        "all": 960,
        "proper": 480,
        "improper": 480,
        "reference": 40,
        "TC6-TO5,TO5-TC6": 40,
    }
    with pytest.raises(SessionError, match="TC6-TO1"):
        chosen_gaits(chosen, "TC6-TO1")
    with pytest.raises(SessionError, match="none of the chosen primitives rolls TO5-TC6"):
        chosen_gaits(chosen_primitives(LIBRARY, "1"), "TO5-TC6")


def test_the_next_trial_starts_where_the_robot_is_and_by_preference_leads_on():
    plan = [slot for slot in planned("1-40") if slot.source in ("TC6", "TO5")]
    first = next_due(plan, "TC6")
    assert first is not None
    assert (first.source, first.target) == ("TC6", "TO5"), "from TO5 something is due, from its other neighbours nothing"
    assert next_due(plan, "TC1") is None
    assert next_due([], "TC1") is None


@settings(max_examples=examples(20), deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 959))
def test_walking_on_as_long_as_it_goes_tries_nothing_twice(seed, failures):
    plan, face = planned("1-2,21-22", seed=seed), "TC6"
    done = set()
    while (slot := next_due(due_of(plan, done), face)) is not None:
        assert slot.gait not in done
        assert slot.source == face
        done.add(slot.gait)
        face = slot.target if (failures + len(done)) % 5 else slot.source
    assert face not in {slot.source for slot in due_of(plan, done)}


def test_the_robot_is_put_where_most_is_due_or_rolls_to_the_nearest():
    plan = [slot for slot in planned("1-40") if slot.source in ("TC1", "TC1", "TO9")]
    assert placing(plan) == max(("TC1", "TO9"), key=lambda face: sum(slot.source == face for slot in plan))
    way = way_to_due(plan, "TC6", FaceGraph(LIBRARY))
    assert way == ("TC6", "TO9")
    with pytest.raises(SessionError, match="complete"):
        placing([])


def test_the_papers_960_trials_take_one_person_one_day_and_few_placings():
    day = estimate(planned("1-40"), "TC6", REAL, LIBRARY)
    assert day.trials == 960
    assert 4 * 3600 < day.wall_s < 10 * 3600
    assert day.placings < 20


def test_duty_is_counted_as_the_bridge_does_and_sets_the_pace():
    plan = planned("1-4,21-24")
    fast = Pace(0.015, 1.0, hands_s=0.0, placing_s=0.0)
    told = estimate(plan, "TC6", fast, LIBRARY)
    busiest_s = sum(work_of(slot, LIBRARY, 0.015).runs_s for slot in plan).max()
    assert told.busiest_s == pytest.approx(busiest_s)
    assert told.rest_s > 0.0
    assert told.wall_s >= 0.9 * (busiest_s / 0.2 - 600.0), "20 % of the time, but for the first window"


def test_nothing_due_takes_no_time():
    assert estimate([], "", REAL, LIBRARY) == (0, 0, 0.0, 0.0, 0.0)
