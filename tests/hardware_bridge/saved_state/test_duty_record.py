# SPDX-License-Identifier: Apache-2.0
"""The struts' running time over restarts of the bridge and of the computer: what nobody knows counts as spent."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import DutyError, StateFileError
from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.saved_state import duty_record
from hardware_bridge.saved_state.duty_record import DutyRecord
from hardware_bridge.saved_state.robot_identity import NAMELESS, Identity
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID, MID_M, Wire

LIMITS = Limits(duty_fraction=0.2, duty_window_s=60.0)
BUDGET_S = 12.0
BLUE = Identity("blue", "c1", "lsc")
VIRTUAL = Identity("instance 1", "c1", "lsc", "/run/prototype")


class Clock:
    """The computer's clocks, and which boot it is."""

    def __init__(self) -> None:
        self.steady_s, self.wall_s, self.boot = 100_000.0, time.time(), "first"

    def sleep(self, seconds: float) -> None:
        self.steady_s += seconds
        self.wall_s += seconds

    def reboot(self, off_s: float, wall_is_off_by_s: float = 0.0) -> None:
        self.boot, self.steady_s = self.boot + "+", 0.0
        self.wall_s += off_s + wall_is_off_by_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(duty_record, "_steady_s", lambda: clock.steady_s)
    monkeypatch.setattr(duty_record, "_boot", lambda: clock.boot)
    monkeypatch.setattr(duty_record, "_wall_s", lambda: clock.wall_s)
    return clock


def ran(run_s: float = 3.0) -> Duty:
    return Duty().ran([run_s] * 6, 100.0, LIMITS)


def save(folder: Path, identity: Identity = BLUE, duty: Duty | None = None, limits: Limits = LIMITS, rested_s: float = 1e6) -> None:
    record = DutyRecord(folder, identity, limits)
    record.load(100.0, 1.0, rested_s)
    record.save(ran() if duty is None else duty, 100.0, force=True)


def used_s(folder: Path, identity: Identity = BLUE, limits: Limits = LIMITS, rested_s: float = 0.0, in_s: float = 0.0) -> float:
    """What counts still, if a bridge is opened now, `in_s` later."""
    used = DutyRecord(folder, identity, limits).load(7.0, 1.0, rested_s).used_s(7.0 + in_s, limits.duty_window_s)
    assert (used == used[0]).all()
    return round(float(used[0]), 6)


def test_what_ran_still_counts_for_the_rest_of_its_window(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path)
    clock.sleep(20.0)
    assert used_s(tmp_path) == used_s(tmp_path, in_s=40.0) == 3.0
    assert used_s(tmp_path, in_s=42.0) == 0.0


def test_it_belongs_to_the_actuators_and_outlives_calibration_and_board(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path)
    assert used_s(tmp_path, Identity("blue", "another", "maestro:crc")) == 3.0


def test_rest_counts_in_robot_time(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path, VIRTUAL)
    clock.sleep(10.0)
    assert not DutyRecord(tmp_path, VIRTUAL, LIMITS).load(0.0, 10.0).used_s(0.0, LIMITS.duty_window_s).any()


def test_a_robot_that_nobody_knows_has_spent_its_time_until_it_has_rested_for_a_window(tmp_path: Path, clock: Clock) -> None:
    for who in (BLUE, NAMELESS):
        assert used_s(tmp_path, who) == used_s(tmp_path, who, in_s=59.9) == math.inf
        assert used_s(tmp_path, who, in_s=60.1) == 0.0
        assert used_s(tmp_path, who, rested_s=45.0, in_s=14.9) == math.inf
        assert used_s(tmp_path, who, rested_s=45.0, in_s=15.1) == 0.0
        assert used_s(tmp_path, who, rested_s=60.0) == 0.0


def test_a_virtual_prototype_is_new_until_it_has_run(tmp_path: Path, clock: Clock) -> None:
    assert used_s(tmp_path, VIRTUAL) == 0.0
    save(tmp_path, VIRTUAL)
    assert used_s(tmp_path, VIRTUAL) == 3.0
    assert used_s(tmp_path, replace(VIRTUAL, robot="instance 2")) == 0.0


def test_what_was_unknown_stays_so_over_restarts_until_the_operator_says_more(tmp_path: Path, clock: Clock) -> None:
    record = DutyRecord(tmp_path, BLUE, LIMITS)
    duty = record.load(0.0, 1.0).ran([2.0] * 6, 5.0, LIMITS)  # homing is never refused
    record.save(duty, 10.0, force=True)
    assert used_s(tmp_path) == used_s(tmp_path, in_s=49.0) == math.inf
    assert used_s(tmp_path, in_s=51.0) == 2.0
    assert used_s(tmp_path, rested_s=60.0) == 2.0, "the word is for what nobody knows; what ran since is known"


def test_a_larger_window_looks_back_further_than_the_record_goes(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path, limits=Limits(duty_window_s=10.0, burst_window_s=10.0))
    assert used_s(tmp_path) == math.inf
    assert used_s(tmp_path, in_s=49.0) == math.inf
    assert used_s(tmp_path, limits=Limits(duty_window_s=10.0, burst_window_s=10.0)) == 3.0


def test_what_moved_without_a_name_counts_for_every_real_robot(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path)
    save(tmp_path, NAMELESS, ran(4.0))
    assert used_s(tmp_path) == 7.0
    assert used_s(tmp_path, NAMELESS, rested_s=60.0) == 4.0
    assert used_s(tmp_path, VIRTUAL) == 0.0


# ---- clocks ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("off_by_s", [0.0, -1e6, 1e9, 3600.0])
def test_within_a_boot_no_setting_of_the_time_matters(tmp_path: Path, clock: Clock, off_by_s: float) -> None:
    save(tmp_path)
    clock.sleep(20.0)
    clock.wall_s += off_by_s
    assert used_s(tmp_path, in_s=40.0) == 3.0
    assert used_s(tmp_path, in_s=42.0) == 0.0


@pytest.mark.parametrize("off_by_s", [0.0, 3600.0, 1e9])
def test_after_a_reboot_only_the_time_since_it_is_certain_to_be_rest(tmp_path: Path, clock: Clock, off_by_s: float) -> None:
    save(tmp_path)
    clock.reboot(off_s=1e5, wall_is_off_by_s=off_by_s)
    clock.sleep(20.0)
    assert used_s(tmp_path, in_s=40.0) == 3.0
    assert used_s(tmp_path, in_s=42.0) == 0.0
    assert used_s(tmp_path, rested_s=60.0, in_s=2.0) == 0.0, "the operator knows that it was switched off"


@pytest.mark.parametrize("off_by_s", [-1e4, -1e9])
def test_after_a_reboot_a_clock_that_was_set_back_makes_no_rest(tmp_path: Path, clock: Clock, off_by_s: float) -> None:
    save(tmp_path)
    clock.reboot(off_s=10.0, wall_is_off_by_s=off_by_s)
    clock.sleep(100.0)
    assert used_s(tmp_path) == 3.0


def test_a_record_from_another_computer_with_a_long_uptime_is_as_old_as_the_calendar_says(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path)
    clock.boot, clock.steady_s = "of the other one", 1e7
    clock.wall_s += 5.0
    assert used_s(tmp_path) == 3.0


def test_without_a_boots_identity_it_might_be_another_boot(tmp_path: Path, clock: Clock) -> None:
    clock.boot = ""
    save(tmp_path)
    clock.steady_s, clock.wall_s = 1e7, clock.wall_s + 5.0
    assert used_s(tmp_path) == 3.0


# ---- files ----------------------------------------------------------------------------------------------------------


def damaged() -> list[dict[str, object]]:
    run = [1.0] * 6
    return [
        {"spells": [[1.0, [2.0]]]},
        {"spells": [[-1.0, run]]},
        {"spells": [[float("nan"), run]]},
        {"spells": [[1.0, [-5.0] * 6]]},
        {"spells": [[1.0, [True] * 6]]},
        {"spells": [[1.0, run]] * 100_000},
        {"spells": "none"},
        {"known_s": -5.0},
        {"known_s": 1e999},
        {"known_s": None},
        {"steady_s": "now"},
        {"wall_s": -1e9},
    ]


@pytest.mark.parametrize("text", ["", "[]", '{"boot": "first"}', *damaged()])
@pytest.mark.parametrize("who", [BLUE, VIRTUAL])
def test_a_record_that_cannot_be_trusted_counts_as_spent_and_is_named(
    tmp_path: Path, clock: Clock, caplog: pytest.LogCaptureFixture, who: Identity, text: str | dict[str, object]
) -> None:
    save(tmp_path, who, Duty())
    (path,) = tmp_path.iterdir()
    path.write_text(text if isinstance(text, str) else json.dumps({**json.loads(path.read_text()), **text}))
    assert used_s(tmp_path, who) == math.inf
    assert len(caplog.records) == 1
    assert str(path) in caplog.text
    assert used_s(tmp_path, who, rested_s=60.0) == 0.0


def test_an_unreadable_record_of_nameless_robots_is_doubt_about_all(tmp_path: Path, clock: Clock) -> None:
    save(tmp_path)
    (tmp_path / "duty-nameless.json").write_text("{")
    assert used_s(tmp_path) == math.inf
    assert used_s(tmp_path, rested_s=60.0) == 3.0


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda more: st.lists(more) | st.dictionaries(st.text(), more),
)


@given(data=JSON, field=st.sampled_from(["robot", "boot", "steady_s", "wall_s", "known_s", "spells"]))
def test_no_content_is_an_error_or_a_gift(tmp_path_factory: pytest.TempPathFactory, data: object, field: str) -> None:
    folder = tmp_path_factory.mktemp("state")
    save(folder, duty=ran(BUDGET_S))
    (path,) = folder.iterdir()
    path.write_text(json.dumps({**json.loads(path.read_text()), field: data}))
    used = DutyRecord(folder, BLUE, LIMITS).load(0.0, 1.0).used_s(0.0, LIMITS.duty_window_s)
    assert (used >= BUDGET_S).all() or field in ("spells", "wall_s", "steady_s")
    assert (used >= 0.0).all()


def test_a_record_of_an_older_software_is_no_knowledge(tmp_path: Path, clock: Clock) -> None:
    old = {"robot": "", "boot": clock.boot, "steady_s": clock.steady_s, "wall_s": clock.wall_s, "spells": []}
    for name in ("duty-dev-rfcomm0.json", "duty-nameless.json"):
        (tmp_path / name).write_text(json.dumps(old))
    assert used_s(tmp_path) == used_s(tmp_path, NAMELESS) == math.inf


def test_it_is_written_now_and_then_and_a_failure_ends_no_motion(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    record = DutyRecord(tmp_path, BLUE, LIMITS)
    record.save(ran(1.0), 100.0)
    before = record.path.read_text()
    record.save(ran(2.0), 100.0)
    assert record.path.read_text() == before, "not again within a second"
    (tmp_path / "file").touch()
    dead = DutyRecord(tmp_path / "file", BLUE, LIMITS)
    with pytest.raises(StateFileError, match="cannot keep the struts' running time in"):
        dead.save(ran(), 100.0, force=True)
    for _ in range(2):
        dead.try_to_save(ran(), 100.0)
    assert len(caplog.records) == 1


# ---- the bridge -----------------------------------------------------------------------------------------------------


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
    edited = replace(rules.calibration.struts[0], trim_us=1)
    other = replace(rules.calibration, struts=(edited, *rules.calibration.struts[1:]))
    for again in (make_bridge(wire.port, rules=tight), make_bridge(wire.port, rules=replace(tight, calibration=other))):
        again.open()
        assert again.snapshot().duty_left_s < 0.5
        with armed(again) as lease, pytest.raises(DutyError, match=r"S1: has run [34]\.\d s of the last 20 s"):
            again.execute(out, lease)
        again.close()


def test_a_robot_that_nobody_knows_may_only_go_back_until_the_operator_says_that_it_rested(
    make_bridge: Callable[..., Bridge], wire: Wire
) -> None:
    bridge = make_bridge(wire.port, rested_s=0.0)
    bridge.open()
    out = Trajectory([1.0], [[MID_M + 0.005, *MID[1:]]])
    with armed(bridge, (MID_M + 0.002, *MID[1:])) as lease:
        with pytest.raises(DutyError, match=r"count as spent for another \d+ s .*; if they have rested, start .* rested_s:=600\.0"):
            bridge.execute(out, lease)
        assert bridge.execute(Trajectory([0.1], [MID]), lease).wait(20.0)
    bridge.close()
    again = make_bridge(wire.port, rested_s=600.0)
    again.open()
    with armed(again) as lease:
        assert again.execute(out, lease).wait(20.0)
