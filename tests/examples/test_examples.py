# SPDX-License-Identifier: Apache-2.0
"""The examples run, and use nothing but the public names."""

import ast
import importlib.util
from pathlib import Path

import matplotlib as mpl
import pytest

import hardware_bridge
import sim_core

EXAMPLES = Path(__file__).parents[2] / "examples"
OURS = {"sim_core", "hardware_bridge", "tensegrity_robot", "tensegrity_lab", "tensegrity_console", "sixstrut_cli"}
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Runs an example's `main` in a folder of its own; what it printed."""
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)

    def run(name, *words):
        spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        module.main(*words)
        return capsys.readouterr().out

    return run


def test_there_are_five():
    assert NAMES == ["bag_to_arrays", "move_a_strut", "one_roll", "own_primitive", "thousand_rolls"]


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_short_and_imports_only_public_names(name):
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module.partition(".")[0] in OURS:
            public = {"sim_core": sim_core.__all__, "hardware_bridge": hardware_bridge.__all__}[node.module]
            assert {alias.name for alias in node.names} <= set(public)


def test_one_roll_is_plotted(run, tmp_path):
    assert "feasible" in run("one_roll")
    assert (tmp_path / "one_roll.png").stat().st_size > 10_000


def test_many_perturbed_rolls(run):
    assert "on 16 virtual robots, ±15 %" in run("thousand_rolls", 16)


def test_a_primitive_of_ones_own_is_judged_in_its_24_gaits(run):
    said = run("own_primitive", 1)
    assert said.count("of 1  ends on") == 24


def test_a_bag_becomes_arrays(run):
    assert "it stood on TC6 → TO5" in run("bag_to_arrays")


def test_a_strut_moves_through_the_bridge(run):
    assert "done: S3 at 239.0 mm" in run("move_a_strut", 3, 0.005, 8.0)
