# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.stats import binom, binomtest

from sim_core.errors import SimError
from sim_core.studies.binomial_intervals import counted, counts_of, rate_of, rates_along


@pytest.mark.parametrize(("successes", "trials"), [(0, 20), (1, 20), (17, 24), (20, 20), (480, 480)])
def test_intervals_are_those_of_clopper_and_pearson(successes, trials):
    rate = rate_of(successes, trials)
    exact = binomtest(successes, trials).proportion_ci(0.95, method="exact")
    assert (rate.low, rate.high) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_an_interval_covers_at_least_as_often_as_it_says():
    trials, truth = 24, 0.83
    covered = [rate_of(k, trials).low <= truth <= rate_of(k, trials).high for k in range(trials + 1)]
    assert binom.pmf(np.arange(trials + 1), trials, truth)[covered].sum() >= 0.95


def test_rates_run_along_the_first_axis():
    wins = np.array([[[True, True], [True, False]], [[False] * 2] * 2])
    assert [(rate.successes, rate.trials) for rate in rates_along(wins)] == [(3, 4), (0, 4)]


def test_levels_are_counted_as_the_paper_does():
    counts = counts_of([rate_of(k, 20) for k in (20, 20, 17, 16, 10, 9)])
    assert counts == (2, 3, 5, 6)
    assert counts.text == "2 at 100 %, 3 above 80 %, 5 at or above 50 %, of 6"


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(SimError, match="valid is at least one trial"):
        rate_of(successes, trials)


@pytest.mark.parametrize(
    ("successes", "trials", "text"),
    [
        (20, 20, "20 of 20 tries, so at least 86 %"),
        (24, 24, "24 of 24 tries, so at least 88 %"),
        (0, 20, "0 of 20 tries, so at most 14 %"),
        (17, 20, "17 of 20 tries, so 62 to 97 %"),
    ],
)
def test_counts_say_what_they_tell_of_the_probability(successes, trials, text):
    assert counted(successes, trials) == text
