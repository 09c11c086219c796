# SPDX-License-Identifier: Apache-2.0
from collections import Counter

import pytest

from sim_core.gaits.cycle import TURNS, Chain, Cycle, CycleStage, faces_of
from sim_core.gaits.library import gait_of, load_library
from sim_core.rolling.batch import Batch, Job, roll_many
from sim_core.rolling.course import Course, stages_of_chain
from sim_core.studies.rehearsal import NO_FACE, Ensemble
from sim_core.uncertainty.perturbation_law import Law, sample


@pytest.fixture(scope="module")
def gaits():
    library = load_library("robust")
    return [gait_of(library.primitives[0], "TC6", "TO5"), gait_of(library.primitives[3], "TC6", "TO7")]


def test_a_rehearsal_counts_what_each_member_does(model, gaits):
    law = Law(0.3)
    rehearsed = Ensemble(model, law, members=6, seed=5).rehearse(gaits)
    members = sample(model, law, 6, 5)
    for gait, found in zip(gaits, rehearsed, strict=True):
        alone = roll_many(members, [Job(m, gait.source, gait.policy, gait.target) for m in range(6)])
        assert found.gait == gait
        assert found.rate.successes == sum(result.feasible for result in alone)
        assert sum(found.outcomes.values()) == 6
        assert sum(found.reasons.values()) == 6 - found.rate.successes


def test_a_prepared_ensemble_says_the_same(model, gaits):
    ready, fresh = (Ensemble(model, members=4) for _ in range(2))
    ready.prepare("TC6", "TO5")
    assert ready.rehearse(gaits) == fresh.rehearse(gaits)


def test_a_chain_is_rehearsed_whole_and_beside_gaits(model, gaits):
    pair = CycleStage((7, 44, -19, -17, -45, -45), 0.0, 4.64), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.82)
    chain, law = Chain(Cycle("C1", pair), faces_of("TC6", "TO5", TURNS[:1])), Law(0.3)
    found, beside = Ensemble(model, law, members=6, seed=5).rehearse([chain, gaits[0]])
    alone = Batch(sample(model, law, 6, 5)).run([Course(m, "TC6", stages_of_chain(chain.rolls)) for m in range(6)])
    assert found.gait == chain
    assert found.rate.successes == sum(result.feasible for result in alone) < 6
    assert found.reasons == Counter(result.reason for result in alone if result.reason)
    assert found.outcomes == Counter(result.ended or NO_FACE for result in alone)
    assert beside.gait == gaits[0]
