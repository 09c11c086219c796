# SPDX-License-Identifier: Apache-2.0
"""Statistics of success rates. Pure functions of arrays; every random one is seeded, so the same data give the same numbers."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from sim_core.studies.binomial_intervals import Rate, rate_of

RESAMPLES = 9_999
SEED = 20_230_401
Floats = NDArray[np.float64]


class MannWhitney(NamedTuple):
    """A two-sided Mann–Whitney U test of two samples.

    Attributes:
        u: pairs (a, b) with a > b, and half of those that are equal.
        p: by the normal approximation with tie and continuity correction.
        permutation_p: by seeded random permutations of the pooled ranks; never below 1 / (RESAMPLES + 1).
        effect: u / (n_a n_b), the probability that a value of a exceeds one of b, ties halved (Vargha and Delaney's A; 0.5: none).
        n_a, n_b: sizes.
    """

    u: float
    p: float
    permutation_p: float
    effect: float
    n_a: int
    n_b: int


def mann_whitney(a: Sequence[float], b: Sequence[float]) -> MannWhitney:
    """Compare two samples (Mann and Whitney 1947). Ties are corrected for; scipy's "exact" p, which ignores them, is not used."""
    x, y = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    ranks = stats.rankdata(np.concatenate([x, y]))
    n, m = len(x), len(y)
    u = float(ranks[:n].sum() - n * (n + 1) / 2)
    if np.ptp(ranks) == 0.0:
        return MannWhitney(u, 1.0, 1.0, 0.5, n, m)
    p = float(stats.mannwhitneyu(x, y, alternative="two-sided", method="asymptotic", use_continuity=True).pvalue)
    rng = np.random.default_rng(SEED)
    shuffled = rng.permuted(np.tile(ranks, (RESAMPLES, 1)), axis=1)[:, :n].sum(axis=1) - n * (n + 1) / 2
    as_far = np.abs(shuffled - n * m / 2) >= abs(u - n * m / 2) - 1e-9
    return MannWhitney(u, p, (1 + int(as_far.sum())) / (1 + RESAMPLES), u / (n * m), n, m)


class Normality(NamedTuple):
    """Lilliefors' test: `distance` between the sample's distribution and a normal one with its own mean and variance; p of it."""

    distance: float
    p: float


def lilliefors(values: Sequence[float]) -> Normality | None:
    """Kolmogorov–Smirnov test of normality with estimated mean and variance (Lilliefors 1967), p by seeded Monte Carlo.

    The plain test's p would be far too large, as mean and variance are the sample's own. None: fewer than 4 values, or all equal.
    """
    x = np.asarray(values, dtype=float)
    if len(x) < 4 or np.ptp(x) == 0.0:
        return None
    rng = np.random.default_rng(SEED)
    how = {"vectorized": True, "n_resamples": RESAMPLES, "alternative": "greater"}
    result = stats.monte_carlo_test(x, rng.standard_normal, _normal_distance, **how)
    return Normality(float(result.statistic), float(result.pvalue))


def _normal_distance(x: Floats, axis: int = -1) -> Floats:
    """Largest distance between empirical and fitted normal distribution, along the last axis."""
    x = np.sort(np.moveaxis(np.asarray(x), axis, -1), axis=-1)
    n = x.shape[-1]
    z = (x - x.mean(axis=-1, keepdims=True)) / x.std(axis=-1, ddof=1, keepdims=True)
    below = stats.norm.cdf(z)
    steps = np.arange(1, n + 1) / n
    return np.maximum((steps - below).max(axis=-1), (below - steps + 1 / n).max(axis=-1))


class TwoKinds(NamedTuple):
    """Do trials of two kinds succeed alike within each stratum?

    Attributes:
        chi2, p: the Cochran–Mantel–Haenszel test without continuity correction; NaN: no stratum tells anything.
        wins, trials: of (first, second) kind.
    """

    chi2: float
    p: float
    wins: tuple[int, int]
    trials: tuple[int, int]


def two_kinds(strata: Sequence[int], first: Sequence[bool], wins: Sequence[bool]) -> TwoKinds:
    """Compare two kinds of trials, stratum by stratum (Mantel and Haenszel 1959).

    Args:
        strata: which stratum (a primitive) each trial is of.
        first: whether it is of the first kind.
        wins: whether it succeeded.
    """
    s, kind, won = np.asarray(strata), np.asarray(first, dtype=bool), np.asarray(wins, dtype=bool)
    excess, variance = _excess(s, kind, won)
    chi2 = float(excess**2 / variance) if variance > 0.0 else float("nan")
    counts = (int(won[kind].sum()), int(won[~kind].sum())), (int(kind.sum()), int((~kind).sum()))
    return TwoKinds(chi2, float(stats.chi2.sf(chi2, 1)), *counts)


def _excess(strata: NDArray[np.generic], chosen: NDArray[np.bool_], won: NDArray[np.bool_]) -> tuple[float, float]:
    """Wins of the chosen trials beyond what chance within the strata gives, and the variance of that (hypergeometric)."""
    excess = variance = 0.0
    for stratum in np.unique(strata):
        inside = strata == stratum
        total, some, wins = int(inside.sum()), int((inside & chosen).sum()), int((inside & won).sum())
        excess += float((inside & chosen & won).sum()) - some * wins / total
        if total > 1:
            variance += some * (total - some) * wins * (total - wins) / (total**2 * (total - 1))
    return excess, variance


class ManyKinds(NamedTuple):
    """Do trials of many kinds succeed alike within each stratum? `statistic`: sum of squared standard excesses; its p."""

    statistic: float
    p: float
    kinds: int


def many_kinds(strata: Sequence[int], kinds: Sequence[int], wins: Sequence[bool]) -> ManyKinds | None:
    """Permutation test: outcomes are shuffled among the trials of each stratum (a primitive).

    Args:
        strata: which stratum each trial is of.
        kinds: which kind (a pair of faces) each trial is of.
        wins: whether each trial succeeded.

    None: no stratum has two kinds and two outcomes.
    """
    s, k, won = np.asarray(strata), np.asarray(kinds), np.asarray(wins, dtype=bool)
    every = np.unique(k)
    expected = np.zeros(len(every))
    variance = np.zeros(len(every))
    for index, kind in enumerate(every):
        excess, variance[index] = _excess(s, k == kind, won)
        expected[index] = float((won & (k == kind)).sum()) - excess
    tells = variance > 0.0
    if not tells.any():
        return None
    onto = (k[:, None] == every[None, tells]).astype(float)

    def statistic(outcomes: NDArray[np.bool_]) -> Floats:
        return (((outcomes @ onto) - expected[tells]) ** 2 / variance[tells]).sum(axis=-1)

    rng = np.random.default_rng(SEED)
    observed = float(statistic(won[None, :])[0])
    shuffled = np.tile(won, (RESAMPLES, 1))
    for stratum in np.unique(s):
        inside = np.flatnonzero(s == stratum)
        shuffled[:, inside] = rng.permuted(shuffled[:, inside], axis=1)
    as_far = int((statistic(shuffled) >= observed - 1e-9).sum())
    return ManyKinds(observed, (1 + as_far) / (1 + RESAMPLES), int(tells.sum()))


class Interval(NamedTuple):
    """Bounds that hold what is sought in 95 % of repetitions."""

    low: float
    high: float


def bootstrap_by_prototype(prototypes: Sequence[int], wins: Sequence[bool]) -> Interval | None:
    """Interval of a success rate, with whole prototypes drawn anew (cluster bootstrap, percentiles 2.5 and 97.5).

    Trials on one prototype share its errors, so they are not independent. None: there is one prototype only.
    """
    p, won = np.asarray(prototypes), np.asarray(wins, dtype=float)
    every = np.unique(p)
    if len(every) < 2:
        return None
    sums = np.array([[won[p == one].sum(), (p == one).sum()] for one in every])
    drawn = np.random.default_rng(SEED).integers(len(every), size=(RESAMPLES, len(every)))
    totals = sums[drawn].sum(axis=1)
    low, high = np.percentile(totals[:, 0] / totals[:, 1], [2.5, 97.5])
    return Interval(float(low), float(high))


class Bin(NamedTuple):
    """Trials whose predicted probability is of one range: its bounds, the mean of the predictions, and what came."""

    low: float
    high: float
    expected: float
    rate: Rate


class Calibration(NamedTuple):
    """How well probabilities predict outcomes.

    Attributes:
        brier: mean squared difference (0: perfect; 0.25: a coin).
        expected, observed: mean probability, share of successes.
        bins: every range of probabilities that has trials.
    """

    brier: float
    expected: float
    observed: float
    bins: tuple[Bin, ...]


EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)


def calibration(probabilities: Sequence[float], wins: Sequence[bool]) -> Calibration | None:
    """Compare predicted probabilities with outcomes (Brier 1950); trials without a prediction (NaN) are left out. None: all are."""
    p, won = np.asarray(probabilities, dtype=float), np.asarray(wins, dtype=bool)
    told = ~np.isnan(p)
    p, won = p[told], won[told]
    if not len(p):
        return None
    places = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    bins = []
    for place in np.unique(places):
        own = places == place
        rate = rate_of(int(won[own].sum()), int(own.sum()))
        bins.append(Bin(EDGES[place], EDGES[place + 1], float(p[own].mean()), rate))
    return Calibration(float(((p - won) ** 2).mean()), float(p.mean()), float(won.mean()), tuple(bins))
