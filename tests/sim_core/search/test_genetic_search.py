# SPDX-License-Identifier: Apache-2.0
import json
from collections import Counter
from dataclasses import replace
from itertools import combinations

import pytest
import yaml

from sim_core.errors import ParameterError
from sim_core.gaits.library import library_text, load_library, parse_library
from sim_core.rolling.batch import Job, roll_many
from sim_core.search.archive import distance_mm
from sim_core.search.genetic_search import Search, SearchPlan, Training, search
from sim_core.search.library_recipes import PLANS
from sim_core.structure.roll_classes import TC_TO, TO_TC
from sim_core.studies.local_runner import run_chunk
from sim_core.uncertainty.perturbation_law import Law

QUICK = SearchPlan(classes=(TO_TC.name,), keep=4, offspring=48, generations=3, polish=1)


@pytest.fixture(scope="module")
def found(prototype):
    return search(prototype, QUICK)


def test_what_is_found_is_feasible_in_the_reference_pair_and_diverse(model, found):
    assert len(found.primitives) == QUICK.keep
    jobs = [Job(0, TO_TC.source, p.policy, TO_TC.target) for p in found.primitives]
    for primitive, result in zip(found.primitives, roll_many([model], jobs), strict=True):
        assert result.feasible, result.reason
        assert primitive.margins["inside_mm"] == pytest.approx(1e3 * result.margin_m, abs=0.2)
    assert all(distance_mm(a.policy, b.policy) >= QUICK.apart_mm for a, b in combinations(found.primitives, 2))
    assert found.model_hash == model.hash


def test_a_stopped_search_goes_on_as_if_it_had_not_been(prototype, found):
    first = Search(prototype, QUICK)
    first.step()
    resumed = Search(prototype, QUICK, state=json.loads(json.dumps(first.state)))
    while not resumed.done:
        resumed.step()
    assert resumed.library() == found


def test_results_do_not_depend_on_the_number_of_workers(prototype, found):
    def one_by_one(chunks, report=None):
        """As a cluster does it: chunks in any order, on workers of one thread."""
        done = {number: run_chunk(chunks[number], threads=1) for number in reversed(range(len(chunks)))}
        return [done[number] for number in range(len(chunks))]

    assert search(prototype, QUICK, one_by_one) == found


def test_a_state_of_another_search_is_refused(prototype):
    state = Search(prototype, QUICK).state
    with pytest.raises(ParameterError, match="another plan or model"):
        Search(prototype, replace(QUICK, seed=2), state=json.loads(json.dumps(state)))


@pytest.mark.slow
def test_training_ranks_by_success_on_the_training_prototypes(prototype):
    training = (Training(Law(0.1), 8, 501), Training(Law(0.05, incline_deg=4.0), 8, 502))
    library = search(prototype, replace(QUICK, keep=3, generations=2, training=training, choice=training, name="tried"))
    rates = [p.margins["success"] for p in library.primitives]
    assert rates == sorted(rates, reverse=True)
    assert all(p.margins["trials"] == 16 for p in library.primitives)
    assert library.provenance["training_trials"] > 0
    assert parse_library(yaml.safe_load(library_text(library)), "text").hash == library.hash


def test_before_the_first_success_merit_is_how_far_the_centre_of_mass_got_past_an_edge(model, prototype):
    running = Search(prototype, replace(QUICK, classes=(TC_TO.name,), offspring=32))
    running.step()
    stuck = [c for c in running._elites[TC_TO.name].ranked if c.merit < 1.0]
    results = roll_many([model], [Job(0, TC_TO.source, c.policy) for c in stuck])
    past = [max(result.past_edge_m.values()) for result in results]
    assert len(past) > 5
    assert past == pytest.approx(sorted(past, reverse=True), abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"active": 0}, "0 active struts"),
        ({"kind": "newest"}, "unknown model 'newest'"),
        ({"classes": ("TC1-TO1",)}, "TC1-TO1"),
        ({"keep": 0}, "keep 0"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(change, message):
    with pytest.raises(ParameterError, match=message):
        replace(QUICK, **change)


def test_a_search_in_stages_begins_with_its_start_and_keeps_what_it_does_not_search(prototype):
    plan = replace(QUICK, classes=("TC6-TO5",), stages=2, start="robust", generations=2, offspring=8, keep=3, apart_mm=8)
    library, start = search(prototype, plan), load_library("robust")
    counts = Counter(p.roll_class.name for p in library.primitives)
    assert counts["TC6-TO5"] == 3
    assert {len(p.policy) for p in library.primitives if p.roll_class.name == "TC6-TO5"} == {12}
    assert [p.policy for p in library.primitives[3:]] == [p.policy for p in start.primitives if p.roll_class.name == "TO5-TC6"]


def test_shipped_plans_are_called_like_their_libraries_and_train_on_no_held_out_seed():
    from sim_core.studies.robustness import HELD_OUT_SEED

    assert all(name == plan.name for name, plan in PLANS.items())
    bred = [plan for plan in PLANS.values() if isinstance(plan, SearchPlan)]
    assert all(t.seed != HELD_OUT_SEED for plan in bred for t in (*plan.training, *plan.choice))
    assert HELD_OUT_SEED not in {seed for pair in PLANS["continuous"].seeds.values() for seed in pair}
