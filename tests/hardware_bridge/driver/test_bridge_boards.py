# SPDX-License-Identifier: Apache-2.0
"""The bridge with each board, emulated behind a real pty with its quirks."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import BoardMismatch, LinkLost, ParameterError, PositionUnknown
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.virtual_prototype.boards.maestro import ControlCenter
from hardware_bridge.virtual_prototype.boards.registry import emulate
from tests.hardware_bridge.boards.test_registry import SPECS
from tests.hardware_bridge.driver.test_bridge import armed, there_and_back
from tests.hardware_bridge.helpers import MID, MID_M, wait_for

Make = Callable[..., Bridge]
IGNORE, OFF, TO_1200 = ControlCenter(), ControlCenter(home_us=0.0), ControlCenter(home_us=1200.0)
QUICK = {"liveness_period_s": 0.05, "liveness_limit_s": 1.0, "silent_board": False, "rested_s": 0.0}


def start(start_prototype: Callable, make_bridge: Make, spec: str, settings: ControlCenter | None = None) -> tuple:
    running = start_prototype(time_scale=4.0, board=emulate(spec, settings=settings))
    bridge = make_bridge(str(running.link), board=parse_board(spec), **QUICK)
    bridge.open()
    return running, bridge


@pytest.mark.parametrize("spec", SPECS)
def test_a_motion_reaches_the_body_as_it_was_sent(start_prototype: Callable, make_bridge: Make, spec: str) -> None:
    running, bridge = start(start_prototype, make_bridge, spec)
    target = MID_M + np.array([0.01, -0.01, 0.02, -0.02, 0.003, 0.0])
    with armed(bridge) as lease:
        assert bridge.execute(Trajectory([2.0], [target]), lease).wait(20.0)
        wait_for(lambda: np.allclose(running.body.lengths_m, target), "the body at its target", 5.0)
        beat = bridge.snapshot().last_seq
        wait_for(lambda: bridge.snapshot().last_seq > beat + 40, "two seconds without a fault")
        assert bridge.snapshot().mode is Mode.ARMED
    history = [(time_s, lengths_m) for time_s, lengths_m in running.body.history if time_s > 0]
    times, lengths = np.array([row[0] for row in history]), np.array([row[1] for row in history])
    assert np.abs(np.diff(lengths, axis=0)).max() < 0.002, "short steps only"
    late = times > times[-1] - 1.5
    speeds = np.abs(np.diff(lengths[late], axis=0)).max(axis=1) / np.diff(times[late])
    assert 0.007 < np.median(speeds) < 0.022, "the motion's pace, or, after late frames, the limit and a pulse a frame"


@pytest.mark.parametrize("spec", SPECS)
def test_stop_leaves_at_most_a_frame_of_motion(start_prototype: Callable, make_bridge: Make, spec: str) -> None:
    running, bridge = start(start_prototype, make_bridge, spec)
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wait_for(lambda: handle.progress().fraction > 0.05, "motion")
        bridge.stop()
    sent_m = bridge.snapshot().lengths_m
    until_s = running.body.time_s + 2.0
    wait_for(lambda: running.body.time_s > until_s, "two seconds after")
    assert running.body.lengths_m == pytest.approx(sent_m)


def test_another_board_than_the_prototypes_is_refused(start_prototype: Callable, make_bridge: Make) -> None:
    running = start_prototype(board=emulate("maestro:crc"))
    for spec in ("lsc", "maestro"):
        with pytest.raises(BoardMismatch, match=f"board is {spec}, but the virtual prototype .* is for maestro:crc"):
            make_bridge(str(running.link), board=parse_board(spec)).open()
    make_bridge(str(running.link), board=parse_board("maestro:crc")).open()


def test_what_does_not_go_together_is_refused_before_a_port_is_opened(make_bridge: Make, tmp_path: Path, rules: Rules) -> None:
    nowhere = str(tmp_path / "nothing")
    with pytest.raises(ParameterError, match="baud is 9600"):
        make_bridge(nowhere, board=parse_board("ssc32"), baud=9600)
    assert make_bridge(nowhere).board_timeout_s is None
    with pytest.raises(BoardMismatch, match="the calibration is for ssc32"):
        make_bridge(nowhere, rules=replace(rules, calibration=replace(rules.calibration, board="ssc32")))


# ---- resets and errors ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spec", ["ssc32", "maestro"])
def test_a_reset_under_power_is_noticed_and_the_positions_are_unknown(
    start_prototype: Callable, make_bridge: Make, spec: str
) -> None:
    running, bridge = start(start_prototype, make_bridge, spec)
    with armed(bridge):
        running.board.reset(running.body.time_s)
        wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "the fault")
    snapshot = bridge.snapshot()
    assert "the board gives S1" in snapshot.reason
    assert "no pulse any more (reset or brown-out)" in snapshot.reason
    assert not any(snapshot.known)
    assert not snapshot.link_ok
    bridge.reset()
    with pytest.raises(PositionUnknown):
        bridge.arm("test", True)
    with armed(bridge, MID):
        assert bridge.snapshot().homed


@pytest.mark.parametrize("settings", [IGNORE, OFF, TO_1200])
def test_an_error_of_a_maestro_latches_and_nothing_is_sent_to_where_the_struts_were(
    start_prototype: Callable, make_bridge: Make, settings: ControlCenter
) -> None:
    running, bridge = start(start_prototype, make_bridge, "maestro", settings)
    with armed(bridge):
        frames = bridge.snapshot().frames_sent
        running.board.receive(b"\x00", running.body.time_s)
        wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "the fault")
        assert bridge.snapshot().frames_sent == frames
    reason = bridge.snapshot().reason
    assert "serial protocol" in reason or "no pulse any more" in reason
    assert "arm with confirmed lengths" in reason
    bridge.reset()
    with pytest.raises(PositionUnknown):
        bridge.arm("test", True)


def test_a_time_out_while_nobody_was_there_is_old_news_but_the_positions_are_unknown(
    start_prototype: Callable, make_bridge: Make
) -> None:
    running, bridge = start(start_prototype, make_bridge, "maestro", ControlCenter(0.0, timeout_s=3.0))
    with armed(bridge):
        pass
    bridge.close()
    assert all(bridge.snapshot().known)
    wait_for(lambda: running.board.errors != 0, "the board's time-out")
    bridge.open()
    wait_for(lambda: not any(bridge.snapshot().known), "unknown positions")
    assert bridge.snapshot().mode is Mode.DISARMED
    with pytest.raises(PositionUnknown):
        bridge.arm("test", True)
    with armed(bridge, MID):
        assert bridge.snapshot().mode is Mode.ARMED


def test_a_maestro_is_never_silent_for_its_time_out_while_the_bridge_is_there(start_prototype: Callable, make_bridge: Make) -> None:
    running, bridge = start(start_prototype, make_bridge, "maestro", ControlCenter(0.0, timeout_s=4 * 4.0 * 0.05))
    assert bridge.board_timeout_s == pytest.approx(0.8), "four periods of its queries, in robot time"
    with armed(bridge):
        until_s = running.body.time_s + 8.0
        wait_for(lambda: running.body.time_s > until_s, "eight seconds of holding")
        assert bridge.snapshot().mode is Mode.ARMED


def test_after_a_cut_frame_the_positions_on_a_maestro_are_unknown_and_on_others_known(
    start_prototype: Callable, make_bridge: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    for spec in ("maestro", "ssc32", "lsc"):
        running, bridge = start(start_prototype, make_bridge, spec)
        with armed(bridge) as lease:
            transport = bridge._link.transport
            whole = transport.write_all

            def cut(data: bytes, whole: Callable = whole, transport: object = transport) -> object:
                if len(data) < 25:  # a query
                    return whole(data)
                monkeypatch.undo()
                whole(data[:10])
                raise LinkLost("port", "cut", "reset", dirty=True)

            monkeypatch.setattr(transport, "write_all", cut)
            bridge.execute(there_and_back(), lease)
            wait_for(lambda bridge=bridge: bridge.snapshot().mode is Mode.FAULT, "the fault")
        bridge.reset()
        assert all(bridge.snapshot().known) == (spec != "maestro")
        with armed(bridge, MID if spec == "maestro" else None) as lease:
            assert bridge.execute(Trajectory([0.5], [[MID_M + 0.002, *MID[1:]]]), lease).wait(20.0)
            want = [MID_M + 0.002, *MID[1:]]
            wait_for(lambda running=running, want=want: np.allclose(running.body.lengths_m, want), "the target")
        bridge.close()
        running.kill()
