# SPDX-License-Identifier: Apache-2.0
"""What `colcon test` asks: the installed package offers its public names. The tests proper are in the repository's `tests/`."""

import pytest

import hardware_bridge


@pytest.mark.parametrize("name", hardware_bridge.__all__)
def test_a_public_name_is_there(name):
    assert getattr(hardware_bridge, name) is not None
