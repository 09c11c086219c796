# SPDX-License-Identifier: Apache-2.0
"""What outcomes of trials say of a robot: weights of an ensemble's members, by Bayes' rule. Pure functions of arrays.

A member is a point in normal scores, z ~ N(0, I) under the prior; `fit_prior` makes a robot of it. A member's likelihood counts
the trials that it predicts: approximate Bayesian computation with a lapse rate as the kernel, so that one odd trial rules out no
member.

    p(y | member) = ε + (1 − 2 ε) [win = y],    w ∝ Π_t p(y_t | member) / Σ_r (n_r / n) q_r(z) / φ(z)

As in all such computation, the tolerance adapts (Del Moral et al. 2012): with few members hardly one predicts all trials, and
weights by the true lapse rate would rest on one or two. Then ε is the smallest that leaves enough members with a say.

Rounds after the first draw from mixtures of normals around the heavy members (population Monte Carlo: Cappé et al. 2004); all
rounds count, weighted as draws from one mixture (the balance heuristic: Veach and Guibas 1995; Cornuet et al. 2012). The prior,
the first round, is part of that mixture, so no weight explodes. What a member is besides z (the errors of its single ropes and
masses, a heading nobody knows) is drawn from its prior each time: its weight is then an unbiased estimate (Andrieu and Roberts
2009).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from sim_core.errors import SimError
from sim_core.structure.arrays import Array

LAPSE = 0.03
"""Probability that a trial comes out other than the very robot would have it: a trip, a misread face."""
FLOOR = 1e-3
"""Added to a kernel's variances, in units of the prior's: one heavy member alone still gives a kernel with a width."""


BISECTIONS = 20


class Kernel(NamedTuple):
    """A mixture of normals that a round was drawn from.

    Attributes:
        centres: (m, d).
        weights: (m,), sum 1.
        root: Cholesky factor of their covariance, (d, d).
    """

    centres: Array
    weights: Array
    root: Array


def log_likelihood(wins: NDArray[np.bool_], observed: NDArray[np.bool_], lapse: float = LAPSE) -> Array:
    """Logarithm of each member's likelihood, (members,), from what members do (members, trials) and what was seen (trials,).

    Raises:
        SimError: a lapse rate outside (0, 0.5), or shapes that do not fit.
    """
    if not 0.0 < lapse < 0.5:
        raise SimError(f"lapse rate {lapse!r}: valid is a number between 0 and 0.5")
    if wins.ndim != 2 or observed.shape != wins.shape[1:]:
        raise SimError(
            f"outcomes of shape {observed.shape} for members' of shape {wins.shape}: valid are (trials,), (members, trials)"
        )
    told = wins == observed
    return np.asarray(np.where(told, math.log1p(-lapse), math.log(lapse)).sum(axis=1))


def normalised(log_weights: Array) -> Array:
    """Weights that sum to 1. Raises SimError: there are none."""
    if not log_weights.size:
        raise SimError("an ensemble without members has no weights: draw at least one")
    weights: Array = np.exp(log_weights - logsumexp(log_weights))
    return np.asarray(weights / weights.sum())


def softened(wins: NDArray[np.bool_], observed: NDArray[np.bool_], lapse: float, log_base: Array, least: float) -> float:
    """The smallest lapse rate, from `lapse` up to a coin's, whose weights have an effective size of at least `least`.

    `log_base` (members,): logarithm of the weights without the trials. Nearly ½ if none will do.
    """

    def size(rate: float) -> float:
        return effective_size(normalised(log_likelihood(wins, observed, rate) + log_base))

    if size(lapse) >= least:
        return lapse
    low, high = lapse, 0.5 - 1e-6
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if size(middle) >= least else (middle, high)
    return high


def effective_size(weights: Array) -> float:
    """Number of equally heavy members that estimate as well: 1 / Σ w² (Kish 1965)."""
    return float(1.0 / (weights**2).sum())


def kernel_around(z: Array, weights: Array) -> Kernel:
    """Smoothed version of weighted members, z (members, d) and weights (members,): a mixture of normals.

    Its centres are drawn towards the mean so that its spread is that of the weights (West 1993; Liu and West 2001); it is as wide
    as so few members in so many dimensions ask for (Silverman 1986).
    """
    mean = weights @ z
    off = z - mean
    spread = (weights[:, None] * off).T @ off
    d = z.shape[1]
    width = (4.0 / ((d + 2.0) * effective_size(weights))) ** (1.0 / (d + 4.0))
    root = np.linalg.cholesky(width**2 * spread + FLOOR * np.eye(d))
    return Kernel(mean + math.sqrt(max(0.0, 1.0 - width**2)) * off, weights, root)


def drawn_from(kernel: Kernel, count: int, rng: np.random.Generator) -> Array:
    """Points of the mixture, (count, d)."""
    chosen = systematic(kernel.weights, count, rng)
    normal = rng.standard_normal((count, kernel.centres.shape[1]))
    return np.asarray(kernel.centres[chosen] + normal @ kernel.root.T)


def log_ratio(kernel: Kernel, z: Array) -> Array:
    """The mixture's density over the prior's, log q(z) − log φ(z), (n,). `z`: (n, d)."""
    heavy = kernel.weights > 0.0
    off = np.linalg.solve(kernel.root, (z[:, None, :] - kernel.centres[None, heavy]).reshape(-1, z.shape[1]).T)
    exponents = -0.5 * (off**2).sum(axis=0).reshape(len(z), -1) - np.log(np.diag(kernel.root)).sum()
    return np.asarray(logsumexp(exponents + np.log(kernel.weights[heavy]), axis=1) + 0.5 * (z**2).sum(axis=1))


def log_weights_of(log_likelihoods: Array, z: Array, first: int, kernels: Sequence[tuple[Kernel, int]]) -> Array:
    """Unnormalised logarithms of the weights of all rounds' members, (members,). See the module.

    `first` members z were drawn from the prior, the others, as many as is said, from `kernels`.
    """
    total = first + sum(count for _, count in kernels)
    parts = [np.full(len(z), math.log(first / total))]
    parts += [log_ratio(kernel, z) + math.log(count / total) for kernel, count in kernels]
    return np.asarray(log_likelihoods - logsumexp(np.array(parts), axis=0))


def systematic(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices of `count` members drawn by weight, with evenly spaced points (Carpenter et al. 1999).

    A member of weight w comes ⌊count w⌋ or ⌈count w⌉ times.
    """
    at = (np.arange(count) + rng.random()) / count
    return np.asarray(np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1))


def quantiles(values: Array, weights: Array, shares: Sequence[float]) -> Array:
    """Weighted quantiles: the smallest value with at least that share of the weight at or below it, (len(shares),)."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    places = np.minimum(np.searchsorted(below, np.asarray(shares) - 1e-12), len(values) - 1)
    return np.asarray(values[order][places])


def predictive(wins: NDArray[np.bool_], weights: Array, lapse: float = LAPSE) -> Array:
    """Probability of success of each trial, (trials,): the weighted share of members that succeed, with the lapse rate."""
    return np.asarray(lapse + (1.0 - 2.0 * lapse) * (weights @ wins))


def predictive_without_own(wins: NDArray[np.bool_], weights: Array, own_log_likelihood: Array, lapse: float = LAPSE) -> Array:
    """`predictive` of tried gaits, each by weights that have not seen its own trials: what these say is then counted once.

    `own_log_likelihood` (members, gaits): of each gait's own trials.
    """
    log_own = np.log(np.maximum(weights, 1e-300))[:, None] - own_log_likelihood
    each = np.exp(log_own - logsumexp(log_own, axis=0))
    return np.asarray(lapse + (1.0 - 2.0 * lapse) * (each * wins).sum(axis=0))


def log_score(probability: Array, observed: NDArray[np.bool_]) -> float:
    """Mean logarithm of the probability given to what happened (Good 1952), in nats: nearer to 0 is better; ln ½ is a coin's."""
    return float(np.log(np.where(observed, probability, 1.0 - probability)).mean())


def beta_mean(prior: float, weight: float, wins: float, trials: float) -> float:
    """Mean of a Beta posterior, (prior · weight + wins) / (weight + trials); trials and wins may be parts of trials.

    Raises:
        SimError: a prior outside [0, 1], a weight that is not positive, or more wins than trials.
    """
    if not 0.0 <= prior <= 1.0 or not weight > 0.0 or not 0 <= wins <= trials:
        raise SimError(
            f"prior {prior!r} of weight {weight!r} and {wins} of {trials}: valid are a probability, a positive weight, "
            "and no more wins than trials"
        )
    return (prior * weight + wins) / (weight + trials)
