# SPDX-License-Identifier: Apache-2.0
"""What `colcon test` asks: every module of the installed package loads. The tests proper are in the repository's `tests/`."""

import pkgutil
from importlib import import_module

import pytest

import sixstrut_cli

MODULES = [module.name for module in pkgutil.walk_packages(sixstrut_cli.__path__, "sixstrut_cli.")]


@pytest.mark.parametrize("name", [name for name in MODULES if not name.endswith("__main__")])
def test_a_module_loads(name):
    assert import_module(name).__name__ == name
