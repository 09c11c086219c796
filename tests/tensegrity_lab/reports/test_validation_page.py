# SPDX-License-Identifier: Apache-2.0
"""The command validate: its page, its pictures, its exit codes."""

import json

import pytest

from sim_core.validation import CASES, Case, Curve, Picture
from sixstrut_cli import app


def fake(measured):
    lines = (Curve("law", (1.0, 2.0), (1.0, 2.0)), Curve("solver", (1.0, 2.0), (1.0, 2.1), marks=True))
    return lambda setting: Case(
        "a block", "It slides.", measured, 1.0, "m", 0.01, "v²", picture=Picture("speed (m/s)", "way (m)", lines)
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
    assert app.run(["validate", "-o", str(tmp_path / "page.md")]) == 0
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "**2 of 2 cases hold.** Model `" in page
    assert "written by `./sixstrut validate`" in page
    assert "images/page/energy.png" in page
    assert 0 < (tmp_path / "images/page/energy.png").stat().st_size < 100_000
    assert "2 of 2 cases hold" in capsys.readouterr().out


def test_a_failing_case_ends_with_code_4_and_is_named(quick, tmp_path, capsys):
    quick(block_sliding_to_rest=1.5, energy=1.0)
    assert app.run(["validate", "-o", str(tmp_path / "page.md")]) == 4
    assert "not within tolerance: block_sliding_to_rest" in capsys.readouterr().err
    assert "**FAILS**" in (tmp_path / "page.md").read_text(encoding="utf-8")


def test_only_some_cases_write_no_page_unless_asked(quick, tmp_path, monkeypatch, capsys):
    quick(block_sliding_to_rest=1.0, energy=1.5)
    monkeypatch.setenv("SIXSTRUT_ROOT", str(tmp_path))
    assert app.run(["validate", "--only", "block*", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [case["case"] for case in document["cases"]] == ["block_sliding_to_rest"]
    assert document["passed"] is True
    assert not (tmp_path / "docs").exists()


def test_a_pattern_without_a_case_is_wrong_usage(capsys):
    assert app.run(["validate", "--only", "no-such-case"]) == 2
    assert "angular_momentum" in capsys.readouterr().err
