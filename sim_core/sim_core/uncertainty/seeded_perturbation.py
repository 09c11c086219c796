# SPDX-License-Identifier: Apache-2.0
"""Perturbed prototypes: the same robot as it might really have been built."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_core.dynamics.model import Model, build_model
from sim_core.errors import ParameterError
from sim_core.structure.topology import TENDONS

MAX_SCALE = 0.3
"""Beyond it some prototypes would need a smaller time step, or have slack ropes."""


def perturb(model: Model, scale: float, seed: int) -> Model:
    """A copy of the model with every member off by its own random error; scale 0 returns the same numbers.

    Uniform and independent at scale s: each rope's stiffness ±s and rest length ±0.17 s, each joint's and the box's mass ±s, each
    strut's stroke ±s/2, friction ±2 s (both coefficients together).

    Args:
        model: the robot's model.
        scale: s, 0.1 for ±10 %.
        seed: same seed and model, same prototype.

    Raises:
        ParameterError: a scale outside [0, MAX_SCALE], or a negative seed.
    """
    if not 0.0 <= scale <= MAX_SCALE:
        raise ParameterError(f"perturbation scale {scale!r}: valid is a number in [0, {MAX_SCALE}]")
    if seed < 0:
        raise ParameterError(f"perturbation seed {seed!r}: valid is a whole number of 0 or more")
    if scale == 0.0:
        return model
    rng, e = np.random.default_rng(seed), model.elements

    def off(count: int, width: float) -> np.ndarray:
        return 1.0 + width * rng.uniform(-1.0, 1.0, count)

    ropes, particles = len(e.cable_ends), len(e.mass_kg)
    assert ropes == 2 * len(TENDONS)
    return build_model(
        model.prototype,
        replace(
            e,
            cable_stiffness_n_m=e.cable_stiffness_n_m * off(ropes, scale),
            cable_rest_m=e.cable_rest_m * off(ropes, 0.17 * scale),
            mass_kg=e.mass_kg * off(particles, scale),
            strut_gain=e.strut_gain * off(6, 0.5 * scale),
            friction=e.friction * off(1, 2.0 * scale),
        ),
    )
