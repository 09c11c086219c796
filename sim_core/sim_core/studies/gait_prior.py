# SPDX-License-Identifier: Apache-2.0
"""Every gait's odds on one robot: from a fitted ensemble, or from what was known before, and from its own trials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.gaits.library import Gait, Library, Primitive, gait_of
from sim_core.gaits.success_probability import load_odds
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.arrays import Array
from sim_core.structure.symmetry import rolls_of
from sim_core.studies.ensemble_fit import Fit, Roll, Seen, wins_of
from sim_core.studies.tasks import Report, silent
from sim_core.uncertainty.importance_weights import predictive, predictive_without_own, systematic

PREDICT_STREAM = 31


def gaits_of(primitives: Sequence[Primitive]) -> list[Gait]:
    """All 24 gaits of each."""
    return [gait_of(p, source, target) for p in primitives for source, target in rolls_of(p.roll_class)]


def roll_of(gait: Gait) -> Roll:
    """What a gait rolls."""
    return Roll(gait.source, gait.target, gait.policy)


def shipped_prior(library: Library) -> Callable[[Gait], float]:
    """Odds before any trial: the shipped ones of the library, else a primitive's success in training."""
    graph = FaceGraph(library, load_odds(library))
    known = {
        (choice.gait.primitive.name, choice.gait.source, choice.gait.target): choice.odds
        for source, target in dict.fromkeys(roll for p in library.primitives for roll in rolls_of(p.roll_class))
        for choice in graph.choices(source, target)
    }
    return lambda gait: known[gait.primitive.name, gait.source, gait.target]


def fitted_prior(
    model: Model, found: Fit, seen: Sequence[Seen], gaits: Sequence[Gait], count: int, report: Report = silent
) -> Mapping[Roll, float]:
    """Odds of gaits by a fitted ensemble; of a tried gait, by all trials but its own, which then count once, by themselves.

    Args:
        model: the robot's model.
        found: the fitted ensemble.
        seen: trials with their outcomes.
        gaits: whose odds are wanted.
        count: members that roll every gait, drawn by weight.
        report: called with (done, total).
    """
    placed = all(one.placed for one in seen)
    drawn = systematic(found.weights, count, np.random.default_rng([found.seed, PREDICT_STREAM]))
    rolls = [roll_of(gait) for gait in gaits]
    wins = wins_of(model, [found.members[number] for number in drawn], [(roll, placed) for roll in rolls], report)
    odds: dict[Roll, float] = dict(zip(rolls, predictive(wins, np.full(count, 1.0 / count), found.lapse).tolist(), strict=True))
    return odds | _tried(found, seen)


def _tried(found: Fit, seen: Sequence[Seen]) -> dict[Roll, float]:
    tried = list(dict.fromkeys(one.roll for one in seen))
    observed = np.array([one.won for one in seen])
    lapse = found.lapses[-1]
    each: Array = np.where(found.wins == observed, np.log1p(-lapse), np.log(lapse))
    own = np.array([each[:, [one.roll == roll for one in seen]].sum(axis=1) for roll in tried]).T
    first = [next(number for number, one in enumerate(seen) if one.roll == roll) for roll in tried]
    return dict(zip(tried, predictive_without_own(found.wins[:, first], found.weights, own, found.lapse).tolist(), strict=True))
