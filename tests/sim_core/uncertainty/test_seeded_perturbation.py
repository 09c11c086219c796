# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError, UnstableStepError
from sim_core.uncertainty.seeded_perturbation import MAX_SCALE, perturb


def test_scale_zero_is_the_same_robot(model):
    assert perturb(model, 0.0, 7).hash == model.hash


def test_same_seed_same_robot_other_seed_another(model):
    assert perturb(model, 0.1, 7).hash == perturb(model, 0.1, 7).hash != perturb(model, 0.1, 8).hash


def test_every_member_is_off_by_its_own_amount_within_the_law(model):
    scale = 0.1
    e, p = model.elements, perturb(model, scale, 7).elements
    for name, width in (
        ("cable_stiffness_n_m", scale),
        ("cable_rest_m", 0.17 * scale),
        ("mass_kg", scale),
        ("strut_gain", scale / 2),
    ):
        ratio = getattr(p, name) / getattr(e, name) - 1.0
        assert np.abs(ratio).max() <= width
        assert len(np.unique(ratio)) == len(ratio)
        assert np.abs(ratio).max() > 0.5 * width
    assert np.ptp(p.friction / e.friction) < 1e-12


@pytest.mark.parametrize(("scale", "seed", "message"), [(-0.1, 1, "scale -0.1"), (0.9, 1, "scale 0.9"), (0.1, -1, "seed -1")])
def test_impossible_perturbations_are_refused(model, scale, seed, message):
    with pytest.raises(ParameterError, match=message):
        perturb(model, scale, seed)


def test_the_time_step_is_stable_for_the_worst_prototype_of_the_largest_scale(model):
    """Light everywhere, stiff and tight ropes, strokes that make the struts shortest."""
    e, s = model.elements, MAX_SCALE
    worst = replace(
        e,
        mass_kg=e.mass_kg * (1.0 - s),
        cable_stiffness_n_m=e.cable_stiffness_n_m * (1.0 + s),
        cable_rest_m=e.cable_rest_m * (1.0 - 0.17 * s),
        strut_gain=e.strut_gain * (1.0 + 0.5 * s),
    )
    assert build_model(model.prototype, worst).dt_s == model.dt_s
    with pytest.raises(UnstableStepError):
        build_model(model.prototype, replace(worst, mass_kg=e.mass_kg * 0.4))
