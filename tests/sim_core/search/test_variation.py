# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_core.search.archive import Candidate
from sim_core.search.variation import ENOUGH, offspring, stranger

ELITES = [Candidate((20 + k, -30, 5, 0, 40, -12), 3.0 - k, {}) for k in range(6)]


@pytest.mark.parametrize("active", [1, 3, 6])
def test_every_policy_keeps_to_the_limit_and_the_number_of_active_struts(active):
    rng = np.random.default_rng(1)
    for _ in range(300):
        for policy in (stranger(rng, 45, active), offspring(rng, ELITES, 45, active)):
            assert max(map(abs, policy)) <= 45
            assert sum(value != 0 for value in policy) <= active


def test_of_a_policy_in_stages_every_stage_is_bred():
    rng, staged = np.random.default_rng(3), [c._replace(policy=c.policy * 2) for c in ELITES]
    bred = np.array([offspring(rng, staged, 45, 6, 2) for _ in range(200)])
    assert bred.shape == (200, 12)
    assert (bred != np.array(staged[0].policy)).any(axis=0).all()
    assert len(stranger(rng, 45, 6, 2)) == 12


def test_offspring_resemble_their_parents_more_than_strangers_do():
    rng = np.random.default_rng(2)

    def typical(draw):
        return np.median([np.abs(np.array(draw()) - ELITES[0].policy).mean() for _ in range(400)])

    assert typical(lambda: offspring(rng, ELITES, 45, 6)) < 0.4 * typical(lambda: stranger(rng, 45, 6))


def test_without_enough_elites_offspring_are_strangers():
    few, none = (
        [offspring(np.random.default_rng(seed), ELITES[:n], 45, 6) for seed in range(20)] for n in (ENOUGH - 1, 0)
    )  # fmt: skip
    assert few == none
