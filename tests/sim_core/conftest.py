# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest

from sim_core.dynamics.model import build_model
from sim_core.structure.parameters import load_prototype


@pytest.fixture(scope="session")
def prototype():
    return load_prototype()


@pytest.fixture(scope="session")
def model(prototype):
    return build_model(prototype)


@pytest.fixture(scope="session")
def undamped(prototype):
    """The robot without mass damping, for closed forms of motion."""
    return build_model(replace(prototype, mass_damping_ratio=0.0))


@pytest.fixture(scope="session")
def floating(prototype):
    """The robot without gravity and mass damping: nothing outside acts on it."""
    return build_model(replace(prototype, mass_damping_ratio=0.0, gravity_m_s2=0.0))
