# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

from sim_core.dynamics.model import build_model
from sim_core.twin.model_versions import frozen_models, label_of, motion_of


def test_the_nominal_robot_is_the_newest_frozen_model_in_numbers_and_in_motion(model):
    """If this fails on purpose: add a version to data/frozen.yaml, then make libraries, sensitivities and the example bag again."""
    newest = frozen_models()[-1]
    assert model.hash == newest.model_hash
    assert motion_of(model) == newest.motion


def test_a_model_is_called_by_its_version_or_else_by_its_hash(model):
    assert label_of(model.hash) == f"{frozen_models()[-1].version} ({model.hash})"
    other = build_model(replace(model.prototype, gravity_m_s2=9.8))
    assert label_of(other.hash) == other.hash
    assert motion_of(other) != motion_of(model)


def test_versions_and_hashes_are_unique():
    rows = frozen_models()
    assert len({row.version for row in rows}) == len({row.model_hash for row in rows}) == len(rows)
