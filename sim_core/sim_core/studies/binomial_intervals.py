# SPDX-License-Identifier: Apache-2.0
"""Success rates with intervals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from sim_core.errors import SimError

CONFIDENCE = 0.95
EXCHANGEABLE = (
    "An interval counts a primitive's trials as independent and alike. That its 24 gaits are alike follows from symmetry, if "
    "the law of the perturbations is symmetric too; they share prototypes, so with few of these an interval is somewhat too narrow."
)
ONE_GAIT = (
    "Every trial has a prototype of its own, so an interval is exact for the reference gait. That it stands for all 24 gaits "
    "follows from symmetry: of the nominal robot and of the perturbations' law."
)
"""What an interval of a primitive's rate takes for granted, with 24 gaits and with one."""


class Rate(NamedTuple):
    """Successes of trials, and the Clopper–Pearson interval of their probability."""

    successes: int
    trials: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Successes / trials."""
        return self.successes / self.trials


def rate_of(successes: int, trials: int, confidence: float = CONFIDENCE) -> Rate:
    """A rate with its exact two-sided binomial interval (Clopper and Pearson 1934).

    Raises:
        SimError: no trials, or more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise SimError(f"{successes} successes of {trials} trials: valid is at least one trial, and 0 to all of them successes")
    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(successes, trials - successes + 1, tail)) if successes else 0.0
    high = float(betaincinv(successes + 1, trials - successes, 1.0 - tail)) if successes < trials else 1.0
    return Rate(int(successes), int(trials), low, high)


def counted(successes: int, trials: int) -> str:
    """Counts, and what they say of the probability with 95 % confidence: "20 of 20 tries, so at least 86 %".

    One bound where all or none succeeded, two otherwise. Raises SimError as `rate_of`.
    """
    rate = rate_of(successes, trials)
    if successes == trials:
        says = f"at least {100 * (1.0 - CONFIDENCE) ** (1.0 / trials):.0f} %"
    elif successes == 0:
        says = f"at most {100 * (1.0 - (1.0 - CONFIDENCE) ** (1.0 / trials)):.0f} %"
    else:
        says = f"{100 * rate.low:.0f} to {100 * rate.high:.0f} %"
    return f"{successes} of {trials} tries, so {says}"


def rates_along(wins: NDArray[np.bool_]) -> list[Rate]:
    """A rate for each first index, over all others."""
    rows = wins.reshape(len(wins), -1)
    return [rate_of(int(row.sum()), row.size) for row in rows]


class Counts(NamedTuple):
    """How many primitives reach the paper's three levels."""

    at_100: int
    above_80: int
    at_least_50: int
    primitives: int

    @property
    def text(self) -> str:
        """The counts as a sentence."""
        return f"{self.at_100} at 100 %, {self.above_80} above 80 %, {self.at_least_50} at or above 50 %, of {self.primitives}"


def counts_of(rates: list[Rate]) -> Counts:
    """Count primitives by their success rate, as the paper's Figure 8 does. In whole numbers: no rounding decides."""
    return Counts(
        sum(rate.successes == rate.trials for rate in rates),
        sum(5 * rate.successes > 4 * rate.trials for rate in rates),
        sum(2 * rate.successes >= rate.trials for rate in rates),
        len(rates),
    )
