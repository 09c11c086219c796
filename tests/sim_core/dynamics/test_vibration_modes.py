# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.vibration_modes import calibrated, first_frequency_hz, resting_modes, vibrated_frequency_hz
from sim_core.errors import ModelError


def test_the_shipped_model_has_the_papers_first_frequency(model):
    assert first_frequency_hz(model) == pytest.approx(4.53, abs=1e-3)


def test_the_lowest_modes_are_a_degenerate_pair_by_the_faces_threefold_symmetry(model):
    lowest = resting_modes(Robot.resting_on(model, "TC6")).frequency_hz[:3]
    assert lowest[0] == pytest.approx(lowest[1], rel=1e-4)
    assert lowest[2] > 1.05 * lowest[1]


def test_a_simulated_free_vibration_has_the_same_frequency(model):
    assert vibrated_frequency_hz(model) == pytest.approx(first_frequency_hz(model), rel=0.005)


def test_calibration_reaches_the_wanted_frequency_by_scaling_stiffness_and_prestress(prototype):
    softer = calibrated(prototype, 4.0)
    assert first_frequency_hz(build_model(softer)) == pytest.approx(4.0, abs=1e-4)
    assert softer.tendon_stiffness_n_m / prototype.tendon_stiffness_n_m == pytest.approx(
        softer.box_rope_stiffness_n_m / prototype.box_rope_stiffness_n_m
    )
    assert softer.tendon_stretch == prototype.tendon_stretch
    assert softer.first_frequency_hz == 4.0


def test_a_frequency_out_of_reach_is_refused(prototype):
    with pytest.raises(ModelError, match="90 Hz"):
        calibrated(prototype, 90.0)


def test_frequencies_scale_with_the_root_of_mass(model):
    """All masses and inertias and the gravity that holds it, scaled: the same shape, slower by the root."""
    e = model.elements
    heavy = build_model(
        model.prototype, replace(e, mass_kg=4 * e.mass_kg, inertia_kg_m2=4 * e.inertia_kg_m2, gravity_m_s2=e.gravity_m_s2 / 4)
    )
    assert first_frequency_hz(heavy) == pytest.approx(
        first_frequency_hz(model) / 2, rel=5e-3
    )  # its friction settles a little differently
    assert np.isfinite(heavy.weight_n)
