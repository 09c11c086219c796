# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError, UnstableStepError
from sim_core.structure.elements import PREVIOUS, elements_of
from sim_core.uncertainty.perturbation_law import (
    GROUPS,
    JUDGED,
    MAX_SCALE,
    Law,
    errors_of,
    groups_of,
    perturb,
    prototype_of,
    sample,
    sample_at,
)

ALL = tuple(GROUPS)


def test_the_default_law_is_the_agreed_one(model):
    law = Law(0.1)
    assert law.groups == JUDGED == ("stiffness", "rest_length", "mass", "stroke", "friction")
    widths = {name: np.abs(rows).max() for name, rows in errors_of(model, law, 5, range(400)).items()}
    agreed = {"stiffness": 0.1, "rest_length": 0.017, "mass": 0.1, "stroke": 0.05, "friction": 0.2, "slope": 0.01}
    for name, width in agreed.items():
        assert 0.98 * width < widths[name] <= width


def test_errors_are_uniform_and_independent_by_default(model):
    errors = errors_of(model, Law(0.1), 5, range(800))["stiffness"] / 0.1
    assert np.abs(errors.mean(axis=0)).max() < 5 / np.sqrt(3 * 800)
    assert np.allclose(errors.var(), 1 / 3, rtol=0.03)
    between = np.corrcoef(errors.T)[np.triu_indices(48, 1)]
    assert np.abs(between).max() < 5 / np.sqrt(800)


def test_the_law_moves_what_it_says(model):
    e, p = model.elements, sample(model, Law(0.1, ALL), 1, 3)[0].elements
    errors = {name: rows[0] for name, rows in errors_of(model, Law(0.1, ALL), 3, [0]).items()}
    np.testing.assert_allclose(p.cable_stiffness_n_m / e.cable_stiffness_n_m - 1, errors["stiffness"], atol=1e-12)
    np.testing.assert_allclose(p.cable_rest_m / e.cable_rest_m - 1, errors["rest_length"], atol=1e-12)
    np.testing.assert_allclose(p.mass_kg / e.mass_kg - 1, errors["mass"], atol=1e-12)
    np.testing.assert_allclose(p.strut_gain - 1, errors["stroke"], atol=1e-12)
    np.testing.assert_allclose(p.friction / e.friction - 1, errors["friction"][0], atol=1e-12)
    size = np.linalg.norm(p.contact_point_m, axis=1) / np.linalg.norm(e.contact_point_m, axis=1) - 1
    np.testing.assert_allclose(size.reshape(12, 5), np.repeat(errors["joint_size"][:, None], 5, axis=1), atol=1e-12)


def test_a_slope_is_the_ground_that_the_parameters_would_tilt(model):
    law = Law(0.2, ("slope",))
    errors = {name: rows[0] for name, rows in errors_of(model, law, 3, [0]).items()}
    tilted = elements_of(replace(model.prototype, ground_slope_rad=tuple(errors["slope"])))
    np.testing.assert_allclose(prototype_of(model, law, errors).elements.gravity_m_s2, tilted.gravity_m_s2, atol=1e-14)


def test_a_payload_offset_moves_the_centre_of_mass_and_no_rope(model):
    law = Law(0.1, ("payload",))
    e, p = model.elements, sample(model, law, 1, 3)[0].elements
    offset = p.position_m[-1] - e.position_m[-1]
    assert 0 < np.abs(offset).max() <= 0.005
    ropes = e.cable_ends[:, 1] == 12
    np.testing.assert_allclose((p.position_m[12] + p.cable_point_2_m[ropes]), e.cable_point_2_m[ropes], atol=1e-15)
    assert p.cable_point_2_m[~ropes].tobytes() == e.cable_point_2_m[~ropes].tobytes()


def test_a_prototype_is_the_same_in_any_company(model):
    for design in ("independent", "sobol"):
        law = Law(0.1, ALL, 0.5, design)
        row = sample(model, law, 4, 9)
        assert [m.hash for m in sample_at(model, law, 9, [3, 1])] == [row[3].hash, row[1].hash]
        assert len({m.hash for m in row}) == 4
        assert sample(model, law, 1, 8)[0].hash != row[0].hash


def test_switching_an_uncertainty_off_leaves_the_others_as_they_are(model):
    full, less = (sample(model, law, 1, 9)[0].elements for law in (Law(0.1), Law(0.1).without("mass")))
    assert less.mass_kg.tobytes() == model.elements.mass_kg.tobytes()
    assert less.cable_rest_m.tobytes() == full.cable_rest_m.tobytes()
    assert sample(model, Law(0.1).only("mass"), 1, 9)[0].elements.mass_kg.tobytes() == full.mass_kg.tobytes()


def test_members_of_a_batch_share_part_of_their_error_and_keep_their_range(model):
    errors = errors_of(model, Law(0.1, correlation=0.6), 5, range(600))
    ropes = errors["stiffness"] / 0.1
    between = np.corrcoef(ropes.T)[np.triu_indices(48, 1)].mean()
    assert between == pytest.approx(6 / np.pi * np.arcsin(0.6 / 2), abs=0.05)  # of uniforms under a Gaussian copula
    assert np.abs(ropes).max() <= 1
    assert np.allclose(ropes.var(), 1 / 3, rtol=0.1)
    box = [abs(np.corrcoef(errors["mass"][:, 12], errors["mass"][:, joint])[0, 1]) for joint in range(12)]
    assert max(box) < 0.2
    assert abs(np.corrcoef(ropes[:, 0], errors["rest_length"][:, 0])[0, 1]) < 0.2


def test_a_sobol_design_fills_the_range_more_evenly(model):
    spread = {}
    for design in ("independent", "sobol"):
        errors = np.hstack(list(errors_of(model, Law(0.1, design=design), 5, range(64)).values()))
        spread[design] = np.abs(errors.mean(axis=0)).mean()
    assert spread["sobol"] < 0.3 * spread["independent"]


def test_scale_zero_and_no_groups_are_the_nominal_robot(model):
    assert sample(model, Law(0.0), 2, 1) == [model, model]
    assert sample(model, Law(0.1, ()), 1, 1)[0] is model


def test_draws_are_not_those_of_the_virtual_prototype(model):
    for seed in (0, 7):
        assert sample(model, Law(0.1), 1, seed)[0].hash != perturb(model, 0.1, seed).hash


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": 0.5}, r"scale 0.5: valid is a number in \[0, 0.3\]"),
        ({"groups": ("mas",)}, "unknown uncertainty 'mas': valid are stiffness"),
        ({"correlation": 1.0}, r"correlation 1.0: valid is a number in \[0, 1\)"),
        ({"design": "grid"}, "unknown design 'grid': valid are independent, sobol"),
    ],
)
def test_an_impossible_law_is_refused(changes, message):
    with pytest.raises(ParameterError, match=message):
        Law(**changes)


def test_uncertainties_are_chosen_in_words():
    assert groups_of("judged, slope,-mass") == ("stiffness", "rest_length", "stroke", "friction", "slope")
    assert groups_of("all") == ALL
    assert groups_of("payload") == ("payload",)
    with pytest.raises(ParameterError, match="unknown uncertainty '-mas': valid are judged, all, stiffness"):
        groups_of("judged,-mas")


def test_negative_seeds_and_parts_that_the_previous_model_lacks_are_refused(model):
    with pytest.raises(ParameterError, match="seed -1"):
        sample(model, Law(0.1), 1, -1)
    previous = build_model(model.prototype, kind=PREVIOUS)
    assert len(sample(previous, Law(0.1), 1, 1)) == 1
    with pytest.raises(ParameterError, match="joint_size cannot vary"):
        sample(previous, Law(0.1, ALL), 1, 1)


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
