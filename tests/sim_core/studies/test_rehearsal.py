# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_core.gaits.library import gait_of, load_library
from sim_core.rolling.batch import Job, roll_many
from sim_core.studies.rehearsal import Ensemble
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
