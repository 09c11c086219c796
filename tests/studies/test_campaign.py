# SPDX-License-Identifier: Apache-2.0
"""A tiny campaign: computed sessions that the other commands read, and the same trials by real processes."""

import re
from pathlib import Path

import pytest

from sim_core.rolling.batch import roll_many
from tensegrity_lab.reports.trial_analysis import read_told
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.ledger_line import Outcome
from tensegrity_lab.studies.fit_trials import read_tries
from tests.sixstrut_cli.test_commands import sixstrut
from tests.studies.campaign_stack_sample import chosen

SMALL = ("--primitives", "1,21", "--gaits", "reference", "--prototypes", "1", "--perturbation", "0.1")


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(240)
def test_a_tiny_campaign_computes_runs_a_sample_on_the_stack_and_reports(tmp_path, monkeypatch):
    folder, page = tmp_path / "campaign", tmp_path / "docs" / "results" / "campaign.md"
    page.parent.mkdir(parents=True)
    (tmp_path / "tests").symlink_to(Path(__file__).parents[1])
    monkeypatch.setenv("SIXSTRUT_ROOT", str(tmp_path))
    words = ["campaign", str(folder), *SMALL, "--libraries", "robust,improved,unheard", "--sample", "1", "--page"]
    done = sixstrut(*words, "--time-scale", "8", limit_s=220)
    assert done.returncode == 0, done.stderr
    assert "library unheard is not shipped: skipped" in done.stderr
    assert "1 of 1 trials agree" in done.stdout
    told = {name: read_told(folder / "sessions" / f"{name}_1") for name in ("robust", "improved")}
    for name, session in told.items():
        assert session.folder.settings.computed == "batch solver"
        assert session.folder.settings.library == name
        assert [line.gait for line in session.valid] == [slot.gait for slot in session.folder.plan]
        assert all(line.virtual_robot and line.bag == "" for line in session.valid)
    stack = list((folder / "stack").iterdir())
    assert len(stack) == 1
    assert list((stack[0] / "bags").glob("*/*.mcap")), "the stack leaves real bags"
    assert read_told(stack[0]).folder.settings.computed == ""
    text = page.read_text(encoding="utf-8")
    assert "Every trial here is virtual" in text
    assert "they do not test the paper's claim" in text
    picture = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert [(page.parent / name).read_bytes()[:4] for name in picture] == [b"\x89PNG"]
    assert (folder / "report" / "robust_against_improved" / "report.html").exists()
    again = sixstrut("report", str(folder / "sessions" / "robust_1"))
    assert again.returncode == 0, again.stderr
    refused = sixstrut(*words)
    assert refused.returncode == 1
    assert "is not empty: give a folder that does not exist yet" in refused.stderr


def test_computed_trials_are_the_solver_s_own_and_a_fit_knows_how_they_began(tmp_path):
    from sim_core.dynamics.model import build_model
    from sim_core.gaits.library import load_library
    from sim_core.rolling.batch import Job
    from sim_core.structure.parameters import load_prototype
    from sim_core.uncertainty.perturbation_law import perturb
    from tests.studies.campaign_batch import session_of

    nominal = build_model(load_prototype())
    session = session_of(tmp_path / "s", nominal, load_library("improved"), "1-3,21", "TC6-TO5,TO5-TC6", 0.3, 5)
    robot = perturb(nominal, 0.3, 5)
    jobs = [Job(0, slot.source, slot.policy_mm, slot.target) for slot in session.plan]
    results = roll_many([robot], jobs)
    lines = read_told(session.path).valid
    for result, line in zip(results, lines, strict=True):
        won = result.returned is not None and result.actuated.face == result.returned.face == line.target
        assert (line.outcome is Outcome.SUCCESS) == won
        assert line.faces == result.faces
    assert len(Ledger(session.path).lines) == 2 * len(lines)
    assert all(one.placed for one in read_tries([session.path], nominal).seen)
    slots = chosen([session], 2, seed=1)
    assert slots == chosen([session], 2, seed=1)
    assert sum(map(len, slots.values())) == 2


def test_libraries_of_which_none_is_shipped_are_a_clear_error(tmp_path):
    result = sixstrut("campaign", str(tmp_path / "c"), *SMALL, "--libraries", "unheard", "--sample", "0")
    assert result.returncode == 1
    assert "none of the libraries unheard is shipped" in result.stderr


def test_cycles_are_refused_with_what_takes_them(tmp_path):
    result = sixstrut("campaign", str(tmp_path / "c"), "--libraries", "continuous", "--primitives", "C1", "--prototypes", "1")
    assert result.returncode == 1
    assert "a campaign takes primitives; `trial` and `robustness --cycles` take cycles" in result.stderr
