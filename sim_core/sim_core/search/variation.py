# SPDX-License-Identifier: Apache-2.0
"""The genetic operators: policies bred from better ones. Genes: every stage's strokes, whole mm, as of the reference pair."""

from collections.abc import Sequence

import numpy as np

from sim_core.search.archive import Candidate
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy

STRANGERS = 0.15
"""Share of the offspring that is drawn at random, so that no corner of the space is given up."""
CROSSED = 0.5
"""Share of the others that has two parents."""
MUTATED = 0.4
"""Chance of a gene to be changed."""
STEPS_MM = (2.0, 5.0, 12.0)
"""Standard deviations of a change; an offspring has one of them."""
CALMED = 0.25
"""Share of the bred offspring in which one stroke is then halved, or left out: towards gentle policies and fewer active struts."""
TOURNAMENT = 3
ENOUGH = 4
"""Elites below which all offspring are strangers."""


def stranger(rng: np.random.Generator, limit_mm: int, active: int, stages: int = 1) -> Policy:
    """A uniformly random policy with at most `active` struts that move."""
    return _fitted(rng.integers(-limit_mm, limit_mm + 1, 6 * stages), limit_mm, active)


def offspring(rng: np.random.Generator, elites: Sequence[Candidate], limit_mm: int, active: int, stages: int = 1) -> Policy:
    """One policy bred from elites (best first), or a stranger; of more than `active` strokes the smallest are left out."""
    if len(elites) < ENOUGH or rng.random() < STRANGERS:
        return stranger(rng, limit_mm, active, stages)
    genes = np.array(_parent(rng, elites).policy)
    if rng.random() < CROSSED:
        genes = np.where(rng.random(len(genes)) < 0.5, genes, _parent(rng, elites).policy)
    changed = rng.random(len(genes)) < MUTATED
    changed[rng.integers(len(genes))] = True
    genes = genes + changed * np.rint(rng.normal(0.0, STEPS_MM[rng.integers(len(STEPS_MM))], len(genes))).astype(int)
    if rng.random() < CALMED:
        strut = rng.integers(len(genes))
        genes[strut] = genes[strut] // 2 if rng.random() < 0.5 else 0
    return _fitted(genes, limit_mm, active)


def _parent(rng: np.random.Generator, elites: Sequence[Candidate]) -> Candidate:
    """The best of a few drawn at random."""
    return elites[int(rng.integers(len(elites), size=TOURNAMENT).min())]


def _fitted(genes: np.ndarray, limit_mm: int, active: int) -> Policy:
    genes = np.clip(genes, -limit_mm, limit_mm)
    if active < 6:
        genes[np.argsort(np.abs(genes), kind="stable")[: 6 - active]] = 0
    return checked_policy(genes.tolist(), limit_mm, MOST_STAGES)
