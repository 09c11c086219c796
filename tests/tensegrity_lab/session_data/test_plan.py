# SPDX-License-Identifier: Apache-2.0
"""What is tried, in which order, and how long it takes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_bridge.safety.limits import Limits
from sim_core.dynamics.model import build_model
from sim_core.gaits.cycle import TURNS, turns_of
from sim_core.gaits.library import load_library
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.parameters import load_prototype
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.plan import (
    MOST_ROLLS,
    chain_in,
    chosen_gaits,
    chosen_primitives,
    due_of,
    next_due,
    odds_of,
    placing,
    plan_of,
    plan_text,
    way_to_due,
)
from tensegrity_lab.session_data.plan import planned as foretold
from tensegrity_lab.trials.time_estimate import HANDS, HELD, Pace, estimate, work_of
from tests.scale import examples
from tests.tensegrity_lab.trials.sessions import cyclic, planned, with_chains

LIBRARY = load_library()
CHAIN = "TC6-TO5-TC3-TO4-TC4"
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


# ---- chains


def test_cycles_are_chosen_by_name_and_all_goes_on_meaning_the_primitives():
    assert [one.name for one in chosen_primitives(cyclic(), "all")] == [p.name for p in cyclic().primitives]
    assert [one.name for one in chosen_primitives(cyclic(), "C1")] == ["C1"]
    assert [one.name for one in chosen_primitives(cyclic(), "cycles,P1")] == [*(c.name for c in cyclic().cycles), "P1"]
    with pytest.raises(SessionError, match=r"P40, C1, .*; cycles: all its cycles"):
        chosen_primitives(cyclic(), "C99")
    with pytest.raises(SessionError, match="'cycles' is none of library robust"):
        chosen_primitives(LIBRARY, "cycles")


def test_words_name_straight_chains_of_twelve_rolls_with_either_turn():
    counts = {word: len(with_chains(word)) for word in ("all", "proper", "improper", "reference")}
    assert counts == {"all": 48, "proper": 24, "improper": 24, "reference": 2}
    straight = [slot.chain.split("-") for slot in with_chains("all")]
    assert {len(faces) for faces in straight} == {13}
    assert all(faces[0] == faces[-1] for faces in straight), "after twelve rolls straight on it stands on its first face again"
    assert {turns_of(faces) for faces in straight} == {(turn,) * 5 for turn in TURNS}
    mixed = chosen_gaits(chosen_primitives(cyclic(), "1,C1"), f"TC6-TO5,{CHAIN}")
    assert [gait.name for gait in mixed] == ["P1 TC6→TO5", "C1 TC6→TO5→TC3→TO4→TC4"]


@pytest.mark.parametrize(
    ("chosen", "words", "why"),
    [
        ("C1", "TC6-TO5", "an odd number of faces from 3 on"),
        ("C1", "TC6-TO5-TC3-TO4", "an odd number of faces from 3 on"),
        ("C1", "TC6-TO5-TC1", "TC1"),
        ("C1", "TC6-TO5-TC9", "TC9"),
        ("C1", "some", "valid for cycles are all, proper, improper, reference, or chains such as"),
        ("1", CHAIN, "no cycle is chosen: say --primitives cycles"),
        (
            "C1",
            "-".join(["TC6-TO5-TC3-TO4-TC4-TO12-TC2-TO3-TC7-TO8-TC5-TO9"] * 2 + ["TC6-TO5-TC3"]),
            f"26 rolls; valid are 2 to {MOST_ROLLS}",
        ),
    ],
)
def test_a_chain_that_cannot_be_is_refused_with_what_can(chosen, words, why):
    with pytest.raises(SessionError, match="--gaits") as caught:
        chosen_gaits(chosen_primitives(cyclic(), chosen), words)
    assert why in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.ros
def test_no_chain_is_longer_than_the_planner_takes():
    from tensegrity_robot.planner.gait_planner_node import PlannerParameters

    assert PlannerParameters().longest_chain == MOST_ROLLS


def test_a_chain_s_slot_tells_its_first_roll_its_ends_and_its_faces_and_chains_with_equal_ends_apart():
    plan = with_chains("reference", repeats=2)
    assert len({slot.gait for slot in plan}) == 4
    assert {(slot.source, slot.target, slot.primitive, slot.roll_class, slot.proper) for slot in plan} == {
        ("TC6", "TC6", "C1", "TC6-TO5", True)
    }
    assert {slot.policy_mm for slot in plan} == {cyclic().cycles[0].stages[0].policy}
    assert plan[0].name == f"C1 {plan[0].chain.replace('-', '→')}"


def test_odds_of_a_chain_are_its_turns_switches_and_the_stay_at_the_end():
    cycle = cyclic().cycles[0]
    surer = max(TURNS, key=lambda turn: 1.0 - cycle.turns[turn].miss)
    for slot in with_chains("reference"):
        chain = chain_in(cyclic(), slot)
        turn = cycle.turns[turns_of(chain.faces)[0]]
        expected = (1.0 - cycle.turns[surer].miss) ** 2 * (1.0 - turn.miss) ** 10 * turn.stayed / turn.leaves
        assert slot.odds == pytest.approx(expected, abs=1e-6)
        assert math.isnan(odds_of(replace(chain, cycle=replace(cycle, turns={}))))


def test_the_nominal_model_foretells_chains_and_gaits_alike():
    chosen = chosen_gaits(chosen_primitives(cyclic(), "C1,1"), "TC6-TO5-TC3,TC6-TO5")
    plan = foretold(chosen, cyclic(), build_model(load_prototype()), 1, 1)
    assert [(slot.name, slot.predicted) for slot in sorted(plan)] == [("C1 TC6→TO5→TC3", True), ("P1 TC6→TO5", True)]


def test_a_plan_with_chains_reads_back_and_one_without_is_written_as_it_ever_was():
    plan = with_chains() + planned("1", "reference")
    assert plan_of(plan_text(plan), "here") == plan
    before = plan_text(planned("1", "reference"))
    assert before.splitlines()[0] == "primitive,roll_class,source,target,repeat,proper,policy_mm,odds,predicted"
    (slot,) = plan_of(before, "here")
    assert slot.chain == ""


def test_a_chain_runs_from_policy_to_policy_and_back_and_needs_no_more_than_rested_struts_have():
    (short,) = with_chains("TC6-TO5-TC3")
    one, other = (np.array(roll.policy) for roll in chain_in(cyclic(), short).rolls)
    slow = work_of(short, cyclic(), 0.1)  # so fast that each roll comes to its end
    ways_mm = abs(one) + abs(other - one) + abs(other)
    assert slow.runs_s == pytest.approx(HELD * 1e-3 * ways_mm / 0.1)
    works = [work_of(slot, cyclic(), 0.015) for slot in (short, *with_chains(CHAIN), *with_chains("reference"))]
    assert all((one.runs_s <= HELD * one.lasts_s).all() for one in works)
    assert works[0].needs_s < works[1].needs_s < min(one.needs_s for one in works[2:])
    assert max(one.needs_s for one in works) <= Limits().burst_fraction * Limits().burst_window_s, (
        "else the session would wait for it forever"
    )
    assert works[0].needs_s > works[0].runs_s.max() + 7.0, "the planner wants two rolls and the way back to be left"


def test_a_session_of_chains_is_estimated_as_one_of_rolls():
    told = estimate(with_chains("reference", repeats=4), "TC6", REAL, cyclic())
    assert (told.trials, told.placings) == (8, 0)
    assert told.busiest_s > 8 * 25.0
    long = with_chains("-".join(["TC6-TO5-TC3-TO4-TC4-TO12-TC2-TO3-TC7-TO8-TC5-TO9"] * 2 + ["TC6"]), repeats=3)
    assert estimate(long, "TC6", REAL, cyclic()).rest_s < 3 * 300.0, "a chain longer than a minute has pauses of its own"
    assert told.wall_s > told.busiest_s / 0.2 - 600.0
