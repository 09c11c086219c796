# SPDX-License-Identifier: Apache-2.0
"""The command validate: its page, its pictures, its exit codes."""

import json

import pytest

from sixstrut_cli import app
from tests.validation import CASES, Case, Comparison, Curve, Picture


def fake(measured):
    lines = (Curve("law", (1.0, 2.0), (1.0, 2.0)), Curve("solver", (1.0, 2.0), (1.0, 2.1), marks=True))
    return lambda setting: Case(
        "a block", "It slides.", "v²", Comparison(measured, 1.0, "m", 0.01), picture=Picture("speed (m/s)", "way (m)", lines)
    )


@pytest.fixture
def quick(monkeypatch):
    """Only two cases, which cost nothing."""

    def use(**measured):
        for name in list(CASES):
            monkeypatch.delitem(CASES, name)
        for name, value in measured.items():
            monkeypatch.setitem(CASES, name, fake(value))

    return use


def test_the_page_and_its_pictures_are_written(quick, tmp_path, capsys):
    quick(block_sliding_to_rest=1.001, energy=1.0)
    assert app.run(["validate", "-o", str(tmp_path)]) == 0
    page = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert "**2 of 2 cases hold.** Model `" in page
    assert "written by `./sixstrut validate --page`" in page
    assert "images/validation/energy.png" in page
    assert 0 < (tmp_path / "images/validation/energy.png").stat().st_size < 100_000
    assert "2 of 2 cases hold" in capsys.readouterr().out


def test_a_failing_case_ends_with_code_4_and_is_named(quick, tmp_path, capsys):
    quick(block_sliding_to_rest=1.5, energy=1.0)
    assert app.run(["validate", "-o", str(tmp_path)]) == 4
    assert "not within tolerance: block_sliding_to_rest" in capsys.readouterr().err
    assert "**FAILS**" in (tmp_path / "validation.md").read_text(encoding="utf-8")


def test_the_repositorys_page_is_written_only_if_asked_for_and_only_whole(quick, tmp_path, monkeypatch, capsys):
    quick(block_sliding_to_rest=1.0, energy=1.5)
    monkeypatch.setenv("SIXSTRUT_ROOT", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").mkdir()
    assert app.run(["validate", "--page", "--only", "block*"]) == 2
    assert "leave --only and --prototype out" in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert app.run(["validate", "--page"]) == 2, "no repository"
    capsys.readouterr()
    assert app.run(["validate", "--only", "block*", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [case["case"] for case in document["cases"]] == ["block_sliding_to_rest"]
    assert document["passed"] is True
    assert (tmp_path / "out/validate/validation.md").is_file()
    assert not (tmp_path / "docs").exists()
    (tmp_path / "docs/results").mkdir(parents=True)
    assert app.run(["validate", "--page"]) == 4
    assert (tmp_path / "docs/results/validation.md").is_file()


def test_a_pattern_without_a_case_is_wrong_usage(capsys):
    assert app.run(["validate", "--only", "no-such-case"]) == 2
    assert "angular_momentum" in capsys.readouterr().err
