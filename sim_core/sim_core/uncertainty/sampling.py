# SPDX-License-Identifier: Apache-2.0
"""Designs of experiments in the unit cube: which errors a study's prototypes get, before they are given a range."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from sim_core.structure.arrays import Array

INDEPENDENT, SOBOL = "independent", "sobol"
DESIGNS = (INDEPENDENT, SOBOL)
STREAM = 24
"""Sets these draws apart from other uses of the same seed."""
EDGE = 2.0**-40
"""Variates are kept this far from 0 and 1, where a normal one would be infinite."""


def unit_rows(design: str, dimensions: int, seed: int, indices: Sequence[int]) -> Array:
    """Points `indices` of an endless design in the unit cube, (len(indices), dimensions).

    Every point is a function of (design, dimensions, seed, index) alone, so any worker can draw its own. SOBOL is a Sobol sequence
    with seeded scrambling (Owen 1998; scipy.stats.qmc), which fills the cube more evenly.
    """
    if design == INDEPENDENT:
        rows = [np.random.default_rng([index, seed, STREAM]).random(dimensions) for index in indices]
        return np.array(rows).reshape(len(rows), dimensions)
    from scipy.stats import qmc  # takes a second to import

    engine = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng([seed, STREAM]))
    found: dict[int, Array] = {}
    for index in sorted(set(indices)):
        if index > engine.num_generated:
            engine.fast_forward(index - engine.num_generated)
        found[index] = engine.random(1)[0]
    return np.array([found[index] for index in indices]).reshape(len(indices), dimensions)


def correlated(own: Array, shared: Array, correlation: float) -> Array:
    """Uniform variates (n, members) that share (n,) a part, by a Gaussian copula: z = √ρ z₀ + √(1 − ρ) zᵢ, ρ in [0, 1)."""
    z, z0 = (ndtri(np.clip(u, EDGE, 1.0 - EDGE)) for u in (own, shared))
    return np.asarray(ndtr(np.sqrt(correlation) * z0[:, None] + np.sqrt(1.0 - correlation) * z))
