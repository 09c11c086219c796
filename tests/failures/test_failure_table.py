# SPDX-License-Identifier: Apache-2.0
"""`sixstrut faults` but for the failures themselves (tests/failures/test_failures.py): rows, texts, the page."""

import pytest
import typer

from sixstrut_cli import app
from sixstrut_cli.commands.develop.faults import ROWS, _numbers
from tensegrity_lab.terminal import compile_notice
from tests.failures import runner
from tests.failures.documented import page_rows, shape_of
from tests.failures.page import as_markdown, without_folders
from tests.failures.runner import Outcome
from tests.failures.scenario import Evidence, expect
from tests.failures.table import RUNNING_ORDER, SCENARIOS


def test_every_row_is_there_once_and_runs_once():
    assert [row.number for row in SCENARIOS] == list(ROWS)
    assert sorted(RUNNING_ORDER) == list(ROWS)


def test_rows_are_chosen_by_number():
    assert _numbers("") == set(ROWS)
    assert _numbers("3, 14") == {3, 14}
    for wrong in ("0", str(len(ROWS) + 1), "3;4", "all", ","):
        with pytest.raises(typer.BadParameter, match=f"valid are numbers from 1 to {len(ROWS)}"):
            _numbers(wrong)


def test_a_page_reads_back_as_it_was_written():
    evidence = Evidence(["a | b", "port /tmp/x/prototype: gone"], {"time [ms]": 1.5}, {"lsc": {"seen": "1.1"}})
    outcomes = [Outcome(row, evidence, "", 1.0) for row in SCENARIOS]
    text = as_markdown(outcomes)
    rows = page_rows(text)
    assert sorted(rows) == list(ROWS)
    for row in SCENARIOS:
        assert rows[row.number] == (row.failure, row.happens, ("a | b", "port prototype: gone"), row.remedy)
    assert "| 3 | time [ms] | 1.5 |" in text
    assert "| `lsc` | 1.1 |" in text


def test_texts_are_compared_without_what_differs_from_run_to_run():
    one = "port /tmp/a-1/state/prototype: took 0 of 25 bytes, hash 0123456789abcdef"
    other = "port prototype: took 3 of 46 bytes, hash ffffffffffffffff"
    assert shape_of(one) == shape_of(other)
    assert shape_of(one) != shape_of(other.replace("took", "lost"))


def test_folders_are_left_out_and_devices_and_calls_are_not():
    assert without_folders("mended /tmp/x/bags/a.mcap: 5") == "mended a.mcap: 5"
    for text in ("port /dev/pts/1: is in use", "ros2 service call /arm tensegrity_interfaces/srv/Arm", "log /proc/sixstrut: no"):
        assert without_folders(text) == text


@pytest.mark.parametrize(("problem", "code"), [("", 0), ("it moved", 4)])
def test_a_failure_that_was_not_survived_is_exit_code_4(problem, code, monkeypatch, capsys):
    monkeypatch.setattr(compile_notice, "compile_first", lambda *stages: None)
    monkeypatch.setattr(runner, "run", lambda *given: [Outcome(SCENARIOS[2], Evidence(), problem, 1.0)])
    assert app.run(["faults", "--only", "3", "--json"]) == code
    assert f'"problem": "{problem}"' in capsys.readouterr().out


def test_evidence_wants_every_part():
    evidence = Evidence()
    evidence.says("FAULT: stop pressed", "FAULT", "stop")
    assert evidence.told == ["FAULT: stop pressed"]
    with pytest.raises(AssertionError, match="expected 'reset' in: 'FAULT'"):
        evidence.says("FAULT", "reset")
    with pytest.raises(AssertionError, match="it moved"):
        expect(False, "it moved")
