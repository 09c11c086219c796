# SPDX-License-Identifier: Apache-2.0
"""The report's statistics: against cases worked out by hand, against the paper's counts, and against each other."""

import math
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from sim_core.studies.binomial_intervals import counts_of, rate_of
from tensegrity_lab.reports.success_statistics import (
    bootstrap_by_prototype,
    calibration,
    lilliefors,
    mann_whitney,
    many_kinds,
    two_kinds,
)


def test_mann_whitney_by_hand():
    # a = 1 3 3, b = 2 3 4: pairs a > b: (3,2) twice; equal: (3,3) twice; U = 2 + 1 = 3 of 9
    told = mann_whitney([1, 3, 3], [2, 3, 4])
    assert told.u == 3.0
    assert told.effect == pytest.approx(3 / 9)
    # variance with ties: n m / 12 (N + 1 − Σ(t³ − t) / (N (N − 1))) = 9/12 (7 − 24/30) = 4.65; z = (4.5 − 3 − 0.5) / √4.65
    assert told.p == pytest.approx(2 * stats.norm.sf(1.0 / math.sqrt(4.65)))


def test_the_permutation_p_agrees_with_all_permutations():
    a, b = [1.0, 2.0, 2.0, 5.0], [2.0, 6.0, 7.0, 8.0, 9.0]
    ranks = stats.rankdata(a + b)
    middle = len(a) * len(ranks) / 2 + len(a) / 2
    far = [abs(sum(chosen) - middle) >= abs(ranks[:4].sum() - middle) - 1e-9 for chosen in combinations(ranks, 4)]
    assert mann_whitney(a, b).permutation_p == pytest.approx(np.mean(far), abs=0.01)


def rates(at_100, above_80, at_least_50, low, middle, high):
    """Forty rates with the paper's counts; those between the levels at the given successes of 24."""
    wins = [24] * at_100 + [high] * (above_80 - at_100) + [middle] * (at_least_50 - above_80) + [low] * (40 - at_least_50)
    told = [rate_of(won, 24) for won in wins]
    assert counts_of(told)[:3] == (at_100, above_80, at_least_50)
    return [rate.value for rate in told]


def test_the_papers_counts_bound_its_p_value():
    # as near to each other as the counts permit, and as far
    nearest = mann_whitney(rates(14, 31, 39, 0, 12, 20), rates(0, 0, 13, 11, 19, 23))
    farthest = mann_whitney(rates(14, 31, 39, 11, 19, 23), rates(0, 0, 13, 0, 12, 23))
    assert nearest.p == pytest.approx(8e-11, rel=0.3)
    assert farthest.p == pytest.approx(6e-15, rel=0.3)
    assert nearest.permutation_p == 1e-4, "never below what the number of permutations can tell"


def test_equal_samples_differ_by_nothing():
    assert mann_whitney([1, 1], [1, 1, 1])[1:4] == (1.0, 1.0, 0.5)


def test_lilliefors_matches_published_critical_values():
    # 5 % critical value for n = 20: 0.190 (Lilliefors 1967), 0.192 (later tables)
    rng = np.random.default_rng(0)
    x = rng.standard_normal(20)
    told = lilliefors(x)
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    distance = max(max((i + 1) / 20 - stats.norm.cdf(v), stats.norm.cdf(v) - i / 20) for i, v in enumerate(z))
    assert told.distance == pytest.approx(distance)
    near = [lilliefors(_with_distance(target)) for target in (0.185, 0.200)]
    assert near[0].p > 0.05 > near[1].p


def _with_distance(target):
    """Twenty values whose distance from their own normal is about the target: a mixture, moved until it fits."""
    base = stats.norm.ppf((np.arange(20) + 0.5) / 20)
    low, high = 0.0, 50.0
    for _ in range(60):
        middle = (low + high) / 2
        x = np.where(base > 1.0, base + middle, base)
        z = np.sort((x - x.mean()) / x.std(ddof=1))
        below = stats.norm.cdf(z)
        distance = max((np.arange(1, 21) / 20 - below).max(), (below - np.arange(20) / 20).max())
        low, high = (middle, high) if distance < target else (low, middle)
    return x


def test_lilliefors_tells_a_uniform_from_a_normal_and_declines_what_it_cannot_judge():
    assert lilliefors(np.concatenate([np.zeros(20), np.ones(20)])).p < 0.001
    assert lilliefors(stats.norm.ppf((np.arange(40) + 0.5) / 40)).p > 0.9
    assert lilliefors([0.5] * 10) is None
    assert lilliefors([0.1, 0.2]) is None


def test_two_kinds_by_hand():
    # one stratum: first 3 of 4, second 1 of 4: excess 3 − 4·4/8 = 1, variance 4·4·4·4 / (64·7) = 4/7, chi² = 7/4
    told = two_kinds([0] * 8, [True] * 4 + [False] * 4, [True] * 3 + [False] + [True] + [False] * 3)
    assert told.chi2 == pytest.approx(7 / 4)
    assert told.p == pytest.approx(stats.chi2.sf(7 / 4, 1))
    assert (told.wins, told.trials) == ((3, 1), (4, 4))
    nothing = two_kinds([0, 0], [True, False], [True, True])
    assert math.isnan(nothing.chi2)


def test_many_kinds_finds_the_pair_that_always_fails_and_nothing_in_noise():
    strata = np.repeat(np.arange(20), 24)
    kinds = np.tile(np.arange(24), 20)
    assert many_kinds(strata, kinds, (kinds != 7) | (strata == 0)).p == 1e-4
    noise = np.random.default_rng(3).random(480) < 0.8
    assert many_kinds(strata, kinds, noise).p > 0.05
    assert many_kinds(strata, kinds, np.ones(480, dtype=bool)) is None


def test_the_bootstrap_draws_prototypes_not_trials():
    # two prototypes, one always succeeds, one never: the rate of a draw is 0, 1/2 or 1
    told = bootstrap_by_prototype([0] * 50 + [1] * 50, [True] * 50 + [False] * 50)
    assert told == (0.0, 1.0)
    assert bootstrap_by_prototype([0] * 9, [True] * 9) is None


def test_calibration_by_hand():
    told = calibration([0.9, 0.9, 0.4, math.nan], [True, False, False, True])
    assert told.brier == pytest.approx((0.01 + 0.81 + 0.16) / 3)
    assert told.expected == pytest.approx(2.2 / 3)
    assert told.observed == pytest.approx(1 / 3)
    assert [(one.low, one.high, one.rate.trials) for one in told.bins] == [(0.0, 0.5, 1), (0.9, 0.95, 2)]
    assert calibration([math.nan], [True]) is None


def test_the_same_data_give_the_same_numbers():
    values = np.random.default_rng(5).random(40)
    assert mann_whitney(values[:20], values[20:]) == mann_whitney(values[:20], values[20:])
    assert lilliefors(values) == lilliefors(values)
