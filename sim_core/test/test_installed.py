# SPDX-License-Identifier: Apache-2.0
"""What `colcon test` asks: the installed package offers its public names. The tests proper are in the repository's `tests/`."""

import pytest

import sim_core


@pytest.mark.parametrize("name", sim_core.__all__)
def test_a_public_name_is_there(name):
    assert getattr(sim_core, name) is not None
