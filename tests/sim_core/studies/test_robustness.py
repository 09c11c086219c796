# SPDX-License-Identifier: Apache-2.0
import pickle
from dataclasses import replace

import numpy as np
import pytest

from sim_core.errors import LibraryError, ParameterError
from sim_core.gaits.library import Library, gait_of, load_library
from sim_core.rolling.batch import Job
from sim_core.rolling.roll import roll
from sim_core.structure.roll_classes import rolls_of
from sim_core.studies.attribution import NOMINAL, TOGETHER, attribute
from sim_core.studies.local_runner import Chunk, Draw, run_chunk, run_here
from sim_core.studies.robustness import StudyPlan, assembled, chunk_jobs, chunks_of, require_held_out, study, training_seeds
from sim_core.uncertainty.perturbation_law import Law, sample


@pytest.fixture(scope="module")
def library():
    return load_library("robust")


@pytest.fixture(scope="module")
def plan():
    return StudyPlan(Law(0.2), seed=7, prototypes=2)


@pytest.fixture(scope="module")
def found(prototype, library, plan):
    return study(prototype, library.primitives[:2], plan)


def test_every_trial_is_the_roll_of_that_gait_on_that_prototype(model, library, plan, found):
    assert found.feasible.shape == (2, 24, 2)
    robots = sample(model, plan.law, 2, plan.seed)
    for p, g, k in ((0, 0, 0), (1, 5, 1), (0, 23, 1)):
        source, target = rolls_of(library.primitives[p].roll_class)[g]
        alone = roll(robots[k], source, target, gait_of(library.primitives[p], source, target).policy)
        assert found.gaits[p][g] == (source, target)
        assert found.feasible[p, g, k] == alone.feasible
        assert found.reasons[found.reason[p, g, k]] == alone.reason
        assert found.margin_m[p, g, k] == np.float32(alone.margin_m)


def test_results_do_not_depend_on_how_the_work_is_cut(monkeypatch, prototype, library, plan, found):
    monkeypatch.setattr("sim_core.studies.robustness.CHUNK_JOBS", 48)
    chunks = chunks_of(prototype, library.primitives[:2], plan)
    assert [len(chunk.jobs) for chunk in chunks] == [48, 48]
    again = assembled(library.primitives[:2], plan, [run_chunk(chunk, threads=1) for chunk in chunks])
    for name in ("feasible", "margin_m", "clearance_m", "peak_force_n", "duration_s"):
        assert getattr(again, name).tobytes() == getattr(found, name).tobytes()


def test_rates_and_costs_add_up(found):
    assert found.overall.trials == found.cost.trials == 96
    assert sum(rate.successes for rate in found.rates) == found.feasible.sum()
    assert [sum(rate.successes for rate in row) for row in found.gait_rates] == [rate.successes for rate in found.rates]
    assert 96 * 5 < found.cost.robot_s < 96 * 40
    assert found.cost.build_s > 0


def test_progress_counts_rolls_to_the_end(prototype, library, plan):
    seen = []
    run_here(chunks_of(prototype, library.primitives[:1], replace(plan, one_gait=True)), lambda *step: seen.append(step))
    assert seen[-1] == (48, 48)
    assert seen == sorted(seen)


def test_a_failure_is_blamed_on_what_it_vanishes_without(model, prototype, library, plan, found):
    blamed = attribute(prototype, found, limit=4)
    assert len(blamed.failures) == 4
    assert blamed.failed == (~found.feasible).sum()
    assert blamed.cost.trials == 4 * (2 * 5 + 1)
    (p, g, k), killer = blamed.failures[0], blamed.killers()[0]
    assert not found.feasible[p, g, k]
    primitive, (source, target) = found.primitives[p], found.gaits[p][g]
    policy = gait_of(primitive, source, target).policy
    for group, vanishes in zip(blamed.groups, blamed.vanishes[0], strict=True):
        spared = sample(model, plan.law.without(group), k + 1, plan.seed)[k]
        assert roll(spared, source, target, policy).feasible == vanishes
    assert killer in (*blamed.groups, NOMINAL, TOGETHER)
    assert sum(sum(c.values()) for c in blamed.killers_by_gait(found).values()) == 4


def test_a_policy_that_never_rolls_is_no_uncertaintys_fault(prototype, library):
    still = replace(library.primitives[0], policy=(0,) * 6)
    blamed = attribute(prototype, study(prototype, [still], StudyPlan(Law(0.05), 7, 1, one_gait=True)), limit=2)
    assert set(blamed.killers()) == {NOMINAL}


def test_nothing_failed_nothing_blamed(prototype, library, found):
    perfect = replace(found, feasible=np.ones_like(found.feasible))
    assert attribute(prototype, perfect, limit=5).killers() == []


def test_one_gait_on_24_times_the_prototypes_has_the_same_rate(prototype, library):
    """Under a symmetric law both estimate one probability: their difference is within four standard errors."""
    primitives, law = library.primitives[:1], Law(0.2)
    all_gaits = study(prototype, primitives, StudyPlan(law, 11, 4))
    one_gait = study(prototype, primitives, StudyPlan(law, 12, 4, one_gait=True))
    assert one_gait.feasible.shape == (1, 1, 96)
    a, b = all_gaits.overall.value, one_gait.overall.value
    pooled = (a + b) / 2
    assert 0.3 < pooled < 0.98, "a primitive that always works would prove nothing"
    assert abs(a - b) < 4 * np.sqrt(2 * pooled * (1 - pooled) / 96)


def test_one_gait_is_refused_where_it_does_not_stand_for_24():
    with pytest.raises(ParameterError, match="leave out slope"):
        StudyPlan(Law(0.1, ("mass", "slope")), one_gait=True)
    with pytest.raises(ParameterError, match="0 prototypes"):
        StudyPlan(prototypes=0)


def test_training_seeds_are_read_from_the_provenance():
    nested = Library(
        "x", "", {"plan": {"seed": 3, "training": 2}, "runs": [{"training_seed": 9, "held_out_seed": 8}], "seeds": [5]}, ()
    )
    assert training_seeds(nested) == {3, 3000, 3001, 9, 5}
    require_held_out(nested, 4)
    with pytest.raises(LibraryError, match="seed 5 is a training seed of library 'x'"):
        require_held_out(nested, 5)


def test_a_prototype_that_cannot_be_built_is_named(prototype):
    soft = replace(prototype, tendon_stretch=1.03)
    with pytest.raises(Exception, match="seed 3 at ±30 % cannot be built: the self-stress is slack"):
        run_chunk(Chunk(soft, (Draw(Law(0.3), 3, 0),), (Job(0, "TC6", (0,) * 6, "TO5"),)))


def test_a_study_can_be_done_in_slices(prototype, library, plan, found):
    second = study(prototype, library.primitives[:2], replace(plan, prototypes=1, first=1))
    assert second.margin_m.tobytes() == found.margin_m[:, :, 1:].tobytes()


def test_cost_is_processor_time_and_never_more_than_the_threads_could_use(found):
    assert 0 < found.cost.core_s < found.cost.robot_s


def test_a_large_study_has_larger_chunks_and_few_enough():
    assert chunk_jobs(5_000) == 1_000
    assert chunk_jobs(5_000_000) == 5_000
    assert chunk_jobs(10**9) == 20_000


def test_a_chunk_is_sent_small(prototype, library):
    chunk = chunks_of(prototype, library.primitives, StudyPlan(prototypes=40), size=12_000)[0]
    sent = pickle.dumps(chunk)
    assert pickle.loads(sent) == chunk
    assert len(chunk.jobs) == 40 * 12 * 24
    assert len(sent) < 12 * len(chunk.jobs)
