"""The struts' running time over a restart of the bridge."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge import duty_record
from hardware_bridge.bridge import Bridge
from hardware_bridge.checks import Rules
from hardware_bridge.duty import Duty
from hardware_bridge.duty_record import DutyRecord
from hardware_bridge.errors import DutyError, StateFileError
from hardware_bridge.limits import Limits
from hardware_bridge.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M, Wire
from tests.hardware_bridge.test_bridge import armed

LIMITS = Limits(duty_fraction=0.2, duty_window_s=60.0)
ALL = (True,) * 6


def ran(run_s: float = 3.0) -> Duty:
    return Duty().ran(ALL, run_s, 100.0, LIMITS)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Sets the computer's steady clock."""

    def at(seconds: float) -> None:
        monkeypatch.setattr(duty_record, "_steady_s", lambda: seconds)

    at(1000.0)
    return at


def test_what_ran_still_counts_for_the_rest_of_its_window(tmp_path: Path, clock: Callable[[float], None]) -> None:
    DutyRecord(tmp_path, "/dev/x").save(ran(), 110.0, force=True)
    clock(1020.0)
    loaded = DutyRecord(tmp_path, "/dev/x").load(0.0, 1.0, LIMITS)
    assert loaded.used_s(0.0, LIMITS) == pytest.approx(np.full(6, 3.0))
    assert loaded.used_s(29.0, LIMITS) == pytest.approx(np.full(6, 3.0)), "59 s old"
    assert not loaded.used_s(32.0, LIMITS).any()


def test_rest_counts_in_robot_time(tmp_path: Path, clock: Callable[[float], None]) -> None:
    DutyRecord(tmp_path, "/dev/x").save(ran(), 110.0, force=True)
    clock(1010.0)
    assert not DutyRecord(tmp_path, "/dev/x").load(0.0, 10.0, LIMITS).used_s(0.0, LIMITS).any()


def test_another_robot_and_a_broken_record_are_no_knowledge(tmp_path: Path) -> None:
    record = DutyRecord(tmp_path, "/dev/x", "one")
    record.save(ran(), 100.0, force=True)
    assert DutyRecord(tmp_path, "/dev/x", "two").load(0.0, 1.0, LIMITS) == Duty()
    assert DutyRecord(tmp_path, "/dev/y", "one").load(0.0, 1.0, LIMITS) == Duty()
    for text in ("", "[]", '{"robot": "one"}', json.dumps({**json.loads(record.path.read_text()), "spells": [[1.0, [2.0]]]})):
        record.path.write_text(text)
        assert record.load(0.0, 1.0, LIMITS) == Duty()


def test_after_a_restart_of_the_computer_the_calendar_counts_and_never_backwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    DutyRecord(tmp_path, "/dev/x").save(ran(), 100.0, force=True)
    monkeypatch.setattr(duty_record, "_boot", lambda: "another")
    now = time.time()
    for later_s, used_s in ((0.0, 3.0), (-5000.0, 3.0), (100.0, 0.0)):
        monkeypatch.setattr("hardware_bridge.duty_record.time.time", lambda later_s=later_s: now + later_s)
        loaded = DutyRecord(tmp_path, "/dev/x").load(0.0, 1.0, LIMITS)
        assert loaded.used_s(0.0, LIMITS) == pytest.approx(np.full(6, used_s))


def test_it_is_written_now_and_then_and_a_failure_ends_no_motion(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    record = DutyRecord(tmp_path, "/dev/x")
    record.save(ran(1.0), 100.0)
    before = record.path.read_text()
    record.save(ran(2.0), 100.0)
    assert record.path.read_text() == before, "not again within a second"
    (tmp_path / "file").touch()
    dead = DutyRecord(tmp_path / "file", "/dev/x")
    with pytest.raises(StateFileError, match="cannot keep the struts' running time in"):
        dead.save(ran(), 100.0, force=True)
    for _ in range(2):
        dead.try_to_save(ran(), 100.0)
    assert len(caplog.records) == 1


def test_a_bridge_started_again_still_refuses_what_the_one_before_did(
    make_bridge: Callable[..., Bridge], rules: Rules, wire: Wire
) -> None:
    tight = replace(rules, limits=Limits(duty_window_s=20.0))
    out = Trajectory([2.0], [[MID_M + 0.02, *MID[1:]]])
    bridge = make_bridge(wire.port, rules=tight)
    bridge.open()
    with armed(bridge) as lease:
        assert bridge.execute(out, lease).wait(20.0)
        assert bridge.execute(Trajectory([2.0], [MID]), lease).wait(20.0)
    bridge.close()
    again = make_bridge(wire.port, rules=tight)
    again.open()
    assert again.snapshot().duty_left_s < 0.5
    with armed(again) as lease, pytest.raises(DutyError, match=r"S1: has run [34]\.\d s of the last 20 s"):
        again.execute(out, lease)
