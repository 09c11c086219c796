# SPDX-License-Identifier: Apache-2.0
"""How probable every gait is to work on one robot.

Before its own trials: from a fitted ensemble, or from what was known of the library. After them: gait by gait (Beta–Bernoulli).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.errors import LibraryError
from sim_core.gaits.library import Gait, Library, Primitive, gait_of
from sim_core.gaits.success_counts import MEANS, SuccessCounts, load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.arrays import Array
from sim_core.structure.roll_classes import rolls_of
from sim_core.studies.ensemble_fit import Fit, Roll, Seen, wins_of
from sim_core.studies.local_runner import Reporter, silent
from sim_core.uncertainty.importance_weights import beta_mean, predictive, predictive_without_own, systematic

PREDICT_STREAM = 31
WEIGHT = 4.0
"""Pseudo-trials that the prior is worth: so many trials of a gait count as much as all that was thought before."""

Tried = Mapping[tuple[str, str, str], tuple[int, int]]
"""(primitive, source, target) -> (successes, trials)."""


def gaits_of(primitives: Sequence[Primitive]) -> list[Gait]:
    """All 24 gaits of each."""
    return [gait_of(p, source, target) for p in primitives for source, target in rolls_of(p.roll_class)]


def roll_of(gait: Gait) -> Roll:
    """What a gait rolls."""
    return Roll(gait.source, gait.target, gait.policy)


def shipped_prior(library: Library) -> Callable[[Gait], float]:
    """Probabilities before any trial: the shipped ones of the library, else a primitive's success in training."""
    return FaceGraph(library, load_success_counts(library)).probability


def fitted_prior(
    model: Model, found: Fit, seen: Sequence[Seen], gaits: Sequence[Gait], count: int, report: Reporter = silent
) -> Mapping[Roll, float]:
    """Probabilities by a fitted ensemble; of a tried gait, by all trials but its own, which then count once, by themselves.

    `count` members roll every gait, drawn by weight.
    """
    placed = all(one.placed for one in seen)
    drawn = systematic(found.weights, count, np.random.default_rng([found.seed, PREDICT_STREAM]))
    rolls = [roll_of(gait) for gait in gaits]
    wins = wins_of(model, [found.members[number] for number in drawn], [(roll, placed) for roll in rolls], report)
    found_by_all: dict[Roll, float] = dict(
        zip(rolls, predictive(wins, np.full(count, 1.0 / count), found.lapse).tolist(), strict=True)
    )
    return found_by_all | _tried(found, seen)


def _tried(found: Fit, seen: Sequence[Seen]) -> dict[Roll, float]:
    tried = list(dict.fromkeys(one.roll for one in seen))
    observed = np.array([one.won for one in seen])
    lapse = found.lapses[-1]
    each: Array = np.asarray(np.where(found.wins == observed, np.log1p(-lapse), np.log(lapse)))
    own = np.array([each[:, [one.roll == roll for one in seen]].sum(axis=1) for roll in tried]).T
    first = [next(number for number, one in enumerate(seen) if one.roll == roll) for roll in tried]
    return dict(zip(tried, predictive_without_own(found.wins[:, first], found.weights, own, found.lapse).tolist(), strict=True))


def learned_counts(
    library: Library, prior: Callable[[Gait], float], tried: Tried, weight: float = WEIGHT, how: str = ""
) -> SuccessCounts:
    """What the planner takes for a gait's counts: the mean of each gait's Beta posterior, its prior worth `weight` trials.

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
    return SuccessCounts(library.primitives_hash, text, MEANS, wins)
