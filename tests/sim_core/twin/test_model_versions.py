# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.twin.model_versions import frozen_models, label_of

STROKES_M = np.array([0.012, -0.021, -0.008, 0.017, -0.026, 0.005])


def motion_of(model):
    """Digest of the state after settling on TC6 and moving by STROKES_M for two seconds: the same on every x86-64 processor."""
    robot = Robot.resting_on(model, "TC6")
    robot.set_targets(model.prototype.strut_length_m + STROKES_M)
    robot.advance(2 * model.steps_per_second)
    return robot.digest()[:16]


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
