# SPDX-License-Identifier: Apache-2.0
"""The ledger: nothing is lost, nothing counts twice, nothing is overwritten."""

import csv
import io
import math
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.csv_tables import write_table
from tensegrity_lab.session_data.ledger import LEDGER, Ledger, standing_of
from tensegrity_lab.session_data.ledger_line import COLUMNS, Event, Outcome, line_of, text_of, utc_ns, utc_text
from tensegrity_lab.session_data.plan import due_of
from tests.tensegrity_lab.trials.sessions import add, begun, planned, with_chains
from tests.tensegrity_lab.trials.sessions import line_of as line_for

PLAN = planned()


def test_a_line_reads_back_as_it_was_written():
    line = replace(line_for(PLAN[3], 7), outcome=Outcome.FAILURE, reason='he said "no", twice', faces=("TC6", "TO5"), robot_s=7.25)
    again = line_of(text_of(line))
    assert replace(again, wall_s=0.0, battery_v=0.0) == replace(line, wall_s=0.0, battery_v=0.0)
    assert math.isnan(again.wall_s)


@given(st.text())
def test_whatever_a_reason_holds_a_line_stays_one_line_and_reads_back(reason):
    line = replace(line_for(PLAN[0], 1), reason=reason)
    text = text_of(line)
    assert len(text.splitlines()) == 1
    assert line_of(text).reason == " ".join("".join(letter if letter.isprintable() else " " for letter in reason).split())


@pytest.mark.parametrize(
    "name", ["=cmd|' /C calc'!A0", "+1+1", "-2+3+cmd", "@SUM(A1)", "'=quoted", "''=twice", "\t=cmd", "\x1b[31m=red"]
)
def test_a_name_that_begins_a_formula_is_text_in_every_table_and_reads_back(name, tmp_path):
    line = replace(line_for(PLAN[0], 1), experimenter=name, policy_mm=(-12, 3, 0, 0, 0, 7))
    shown = " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())
    text = text_of(line)
    (cells,) = csv.reader([text])
    row = dict(zip(COLUMNS, cells, strict=True))
    assert row["experimenter"][0] not in "=+-@\t\r"
    assert row["policy_mm"] == "-12 3 0 0 0 7"
    assert line_of(text).experimenter == shown
    table = write_table(tmp_path / "t.csv", [{"who": shown, "n": -5, "share": -0.5, "shown": "-1.5e-3"}])
    (header, who) = csv.reader(table.read_text(encoding="utf-8").splitlines())
    assert header == ["who", "n", "share", "shown"]
    assert who[0][0] not in "=+-@"
    assert who[1:] == ["-5", "-0.5", "-1.5e-3"]


@pytest.mark.parametrize("row", ["", '"', "a\x00b", "x" * 200_000, "begin," + "9" * 5000])
def test_a_row_that_is_none_is_damage_whatever_its_check_says(row):
    with pytest.raises(SessionError):
        line_of(f"{row},{zlib.crc32(row.encode()):08x}")


@given(st.integers(0, 4_000_000_000_000_000))
def test_times_keep_their_microseconds(microseconds):
    assert utc_ns(utc_text(microseconds * 1000)) == microseconds * 1000


def test_a_ledger_is_a_table_that_anybody_can_read(tmp_path):
    ledger = Ledger(tmp_path)
    add(ledger, PLAN[0], Outcome.SUCCESS)
    rows = list(csv.DictReader(io.StringIO((tmp_path / LEDGER).read_text(encoding="utf-8"))))
    assert list(rows[0]) == list(COLUMNS)
    assert [row["event"] for row in rows] == ["begin", "trial"]
    assert rows[1]["outcome"] == "success"


def test_cut_anywhere_it_keeps_every_whole_line_and_goes_on(tmp_path):
    ledger = Ledger(tmp_path)
    for slot in PLAN[:2]:
        add(ledger, slot, Outcome.SUCCESS)
    whole = (tmp_path / LEDGER).read_bytes()
    ends = [at for at, byte in enumerate(whole) if byte == ord("\n")]
    for cut in range(ends[0] + 1, len(whole), 13):
        (tmp_path / LEDGER).write_bytes(whole[:cut])
        torn = Ledger(tmp_path)
        # a line without its end counts if its check is right: it is all there
        assert len(torn.lines) == sum(end <= cut for end in ends[1:])
        assert torn.damaged == (whole[cut - 1 : cut] != b"\n" and cut not in ends)
        began = torn.standing().open
        number = torn.standing().last_number
        if began is None:
            torn.append(began := line_for(PLAN[5], number + 1))
        torn.append(replace(began, event=Event.TRIAL, outcome=Outcome.VOID))
        after = Ledger(tmp_path)
        assert [text_of(line) for line in after.lines] == [text_of(line) for line in torn.lines]
        assert after.standing().open is None
        assert (tmp_path / LEDGER).read_bytes().startswith(whole[:cut])


def test_an_undo_is_a_line_that_revokes_and_the_gait_is_due_again(tmp_path):
    ledger = Ledger(tmp_path)
    first = add(ledger, PLAN[0], Outcome.SUCCESS)
    size = (tmp_path / LEDGER).stat().st_size
    ledger.append(replace(first, event=Event.REVOKE))
    assert (tmp_path / LEDGER).stat().st_size > size
    standing = ledger.standing()
    assert standing.revoked == {1}
    assert standing.done() == set()
    assert standing.last_number == 1
    add(ledger, PLAN[0], Outcome.FAILURE)
    assert [line.number for line in ledger.standing().valid] == [2]


def test_void_is_not_failure(tmp_path):
    ledger = Ledger(tmp_path)
    add(ledger, PLAN[0], Outcome.VOID)
    assert ledger.standing().valid == []
    assert ledger.standing().done() == set()
    assert list(ledger.standing().trials) == [1]


def test_a_trial_that_began_and_did_not_end_is_known(tmp_path):
    ledger = Ledger(tmp_path)
    ledger.append(line_for(PLAN[0], 1))
    began = Ledger(tmp_path).standing().open
    assert began is not None
    assert began.gait == PLAN[0].gait


@pytest.mark.parametrize(
    ("events", "complaint"),
    [
        ([(Event.TRIAL, 1)], "ends trial 1"),
        ([(Event.BEGIN, 2)], "begins trial 2 where 1 is due"),
        ([(Event.BEGIN, 1), (Event.BEGIN, 2)], "begins trial 2 where an end is due"),
        ([(Event.REVOKE, 1)], "revokes trial 1, which does not stand"),
        ([(Event.BEGIN, 1), (Event.TRIAL, 1), (Event.REVOKE, 1), (Event.REVOKE, 1)], "revokes trial 1"),
    ],
)
def test_lines_that_contradict_each_other_are_refused(events, complaint):
    lines = [replace(line_for(PLAN[0], number, event), outcome=Outcome.SUCCESS) for event, number in events]
    with pytest.raises(SessionError, match=complaint):
        standing_of(lines)


def test_a_chain_s_line_tells_its_faces_and_rolls_and_chains_with_equal_ends_are_due_apart(tmp_path):
    plan = with_chains("reference")
    ledger = Ledger(begun(tmp_path / "s", plan).path)
    done = add(ledger, plan[0], Outcome.FAILURE, rolls=7)
    again = Ledger(tmp_path / "s").lines[-1]
    assert (again.chain, again.rolls, again.wanted, again.gait) == (plan[0].chain, 7, 12, plan[0].gait)
    assert (again.name, again.ended) == (plan[0].name, "failure, 7 of 12 rolls")
    assert done.target == plan[0].source == plan[1].source == plan[1].target
    assert due_of(plan, ledger.standing().done()) == [plan[1]]


def test_a_ledger_of_before_reads_and_goes_on_with_its_own_columns(tmp_path):
    head = "event,number,recorded,session,experimenter,robot,virtual_robot,library,library_hash,primitive,roll_class,source,target,"
    head += "repeat,proper,policy_mm,odds,predicted,outcome,reason,observed_face,faces,began,robot_s,wall_s,battery_v,faults,bag,"
    head += "bag_offset_s,check"
    when = "2026-01-02T03:04:05.678901Z"
    facts = f"{when},s,Ada,ours,true,robust,0123456789abcdef,P1,TC6-TO5,TC6,TO5,1,true,-8 45 -15 20 -45 -34,0.9,true"
    rows = [f"begin,1,{facts},,,,,{when},,,,,a.mcap,1.5", f"trial,1,{facts},success,,TO5,TC6 TO5,{when},7.0,8.0,,,a.mcap,1.5"]
    old = "".join(f"{text}\n" for text in [head, *(f"{row},{zlib.crc32(row.encode()):08x}" for row in rows)])
    (tmp_path / LEDGER).write_text(old, encoding="utf-8")
    ledger = Ledger(tmp_path)
    (line,) = ledger.standing().valid
    assert (line.gait, line.chain, line.rolls, ledger.damaged) == (("P1", "TC6", "TO5", 1), "", 0, 0)
    add(ledger, PLAN[0], Outcome.SUCCESS)
    assert Ledger(tmp_path).damaged == 0
    assert len(Ledger(tmp_path).standing().valid) == 2
    table = list(csv.DictReader(io.StringIO((tmp_path / LEDGER).read_text(encoding="utf-8"))))
    assert [row["check"] for row in table] == [text.rpartition(",")[2] for text in (tmp_path / LEDGER).read_text().splitlines()[1:]]


def test_another_file_is_refused_by_name(tmp_path):
    (tmp_path / LEDGER).write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(SessionError, match=r"ledger\.csv is not a ledger of this version: its first line is 'a,b'"):
        Ledger(tmp_path)
