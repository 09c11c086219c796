# SPDX-License-Identifier: Apache-2.0
"""`import sim_core` and `import hardware_bridge`: what they offer, and that it costs nothing until it is used."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ("sim_core", "hardware_bridge")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there_and_has_a_docstring(package):
    module = importlib.import_module(package)
    assert set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        assert getattr(module, name).__doc__, name
        assert f"`{name}`" in module.__doc__ or f"`{name}." in module.__doc__, f"the package's docstring does not tell {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_see_the_same_names_in_the_same_places(package):
    module = importlib.import_module(package)
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: node.module for node in block.body for alias in node.names}
    assert seen == {name: f"{package}.{place}" for name, place in module._MODULES.items()}
    assert sorted(seen) == module.__all__


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_loads_none_of_the_numerics(package):
    code = f"import sys, {package}; assert not {{'numpy', 'scipy', 'numba', 'yaml'}} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_is_not_there_is_told_with_those_that_are(package):
    with pytest.raises(AttributeError, match="public are "):
        _ = importlib.import_module(package).nonsense
