# SPDX-License-Identifier: Apache-2.0
"""Odds of a library's gaits on one robot: what was thought before, and what its own trials say, gait by gait (Beta–Bernoulli)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from sim_core.errors import LibraryError
from sim_core.gaits.library import Gait, Library, gait_of
from sim_core.gaits.success_probability import MEANS, Odds
from sim_core.structure.symmetry import rolls_of
from sim_core.uncertainty.importance_weights import beta_mean

WEIGHT = 4.0
"""Pseudo-trials that the prior odds are worth: so many trials of a gait count as much as all that was thought before."""

Tried = Mapping[tuple[str, str, str], tuple[int, int]]
"""(primitive, source, target) -> (successes, trials)."""


def learned_odds(library: Library, prior: Callable[[Gait], float], tried: Tried, weight: float = WEIGHT, how: str = "") -> Odds:
    """Odds for the planner: the mean of each gait's Beta posterior.

    Args:
        library: the gait library.
        prior: probability of each gait before its trials.
        tried: successes and trials of each tried gait.
        weight: its pseudo-trials.
        how: where prior and trials come from.

    Raises:
        LibraryError: a tried gait is not the library's.
        SimError: an impossible prior, weight or count.
    """
    wins, left = {}, dict(tried)
    for primitive in library.primitives:
        row = []
        for source, target in rolls_of(primitive.roll_class):
            won, trials = left.pop((primitive.name, source, target), (0, 0))
            mean = beta_mean(prior(gait_of(primitive, source, target)), weight, won, trials)
            row.append(min(MEANS, max(0, round(mean * (MEANS + 2)) - 1)))
        wins[primitive.name] = tuple(row)
    if left:
        name, source, target = next(iter(left))
        raise LibraryError(f"library {library.name!r} has no gait {name} {source}→{target}: give the library that was tried")
    text = f"{how}; means of Beta posteriors, prior worth {weight:g} trials, written as counts out of {MEANS}: not trials"
    return Odds(library.hash, text, MEANS, wins)
