# SPDX-License-Identifier: Apache-2.0
"""The bridge on a real pty, whose far end is only bytes, so that what a board would get is seen and nothing else."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge.boards.lsc import CMD_BATTERY, Move
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.driver.events import FaceEvent, SentEvent, Snapshot
from hardware_bridge.errors import (
    DutyError,
    FaultLatched,
    LeaseError,
    LimitError,
    ParameterError,
    PortBusy,
    PortMissing,
    PositionUnknown,
    ShapeError,
    StaleError,
    StateError,
    StateFileError,
    SupplyError,
    TimeScaleError,
)
from hardware_bridge.safety.limit_checks import Rules, check_frame
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.supervisor_messages import Mode, MotionOutcome
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M, Wire, wait_for

Make = Callable[..., Bridge]


@contextmanager
def kept_alive(bridge: Bridge, lease: str) -> Iterator[None]:
    """Proves the lease until the end of the block, as a live commander would."""
    ended = threading.Event()

    def prove() -> None:
        while not ended.wait(0.1):
            try:
                bridge.prove(lease)
            except (LeaseError, StateError):
                return

    thread = threading.Thread(target=prove)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def armed(bridge: Bridge, confirmed: tuple[float, ...] | None = MID) -> Iterator[str]:
    lease = bridge.arm("test", True, confirmed)
    with kept_alive(bridge, lease):
        wait_for(lambda: bridge.snapshot().mode is Mode.ARMED, "ARMED")
        yield lease


def there_and_back(stroke_m: float = 0.02, time_s: float = 2.0) -> Trajectory:
    return Trajectory([time_s, 2 * time_s], [[MID_M + stroke_m, *MID[1:]], MID])


def one_step() -> Trajectory:
    return Trajectory([0.1], [[MID_M + 0.001, *MID[1:]]])


# ---- opening --------------------------------------------------------------------------------------------------------


def test_opening_moves_nothing_and_beats(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    wait_for(lambda: len(sent) >= 10, "ten heartbeats")
    bridge.close()
    assert all(event.heartbeat and event.frame == b"" and event.lengths_m == MID for event in sent)
    assert not any(any(event.known) for event in sent)
    assert [event.seq for event in sent] == list(range(1, len(sent) + 1))
    gaps = np.diff([event.robot_time_ns for event in sent]) / 1e6
    assert np.median(gaps) == pytest.approx(50.0, abs=10.0)
    assert {frame.command for frame in wire.listen()} <= {CMD_BATTERY}


def test_a_missing_port_is_named(make_bridge: Make, tmp_path: Path) -> None:
    with pytest.raises(PortMissing, match="rfcomm9"):
        make_bridge(str(tmp_path / "rfcomm9")).open()


def test_a_second_bridge_is_refused_and_the_first_goes_on(make_bridge: Make, wire: Wire) -> None:
    first = make_bridge(wire.port)
    first.open()
    with pytest.raises(PortBusy):
        make_bridge(wire.port).open()
    assert first.snapshot().link_ok
    with pytest.raises(StateError, match="open"):
        first.open()


def test_a_real_port_has_real_time(make_bridge: Make, wire: Wire) -> None:
    with pytest.raises(TimeScaleError, match="no living virtual prototype, valid is 1 only"):
        make_bridge(wire.port, time_scale=8.0).open()
    make_bridge(wire.port, time_scale=1.0).open()


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), 1000.0])
def test_an_impossible_time_scale_is_refused(make_bridge: Make, wire: Wire, scale: float) -> None:
    with pytest.raises(ParameterError):
        make_bridge(wire.port, time_scale=scale)


def test_a_closed_bridge_takes_no_commands_but_stop(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    for command in (
        lambda: bridge.arm("test", True, MID),
        lambda: bridge.execute(one_step(), "x"),
        lambda: bridge.disarm("x"),
        lambda: bridge.prove("x"),
        lambda: bridge.hold("x"),
        lambda: bridge.reset(),
        lambda: bridge.observe_face("TC1", "operator", True),
    ):
        with pytest.raises(StateError, match="closed"):
            command()
    bridge.stop()
    bridge.open()
    assert bridge.snapshot().mode is Mode.FAULT, "opening does not make a stop undone"


# ---- arming and moving ----------------------------------------------------------------------------------------------


def test_homing_puts_one_strut_after_another_under_power(make_bridge: Make, wire: Wire) -> None:
    states: list[Snapshot] = []
    bridge = make_bridge(wire.port, on_state=states.append)
    bridge.open()
    with armed(bridge):
        moves = wire.moves()
        assert [move.channels for move in moves[:6]] == [(1,), (2,), (3,), (4,), (5,), (6,)]
        assert all(move.channels == (1, 2, 3, 4, 5, 6) for move in moves[6:])
        assert [state.mode for state in states] == [Mode.DISARMED, Mode.HOMING, Mode.HOMING, Mode.ARMED]
        assert bridge.snapshot().lease_holder == "test"


def test_what_is_sent_is_what_is_told(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(Trajectory([0.5], [[MID_M + 0.00777, *MID[1:]]]), lease)
        assert handle.wait(20.0)
    result = handle.result()
    assert result is not None
    assert result.success
    assert result.lengths_m == pytest.approx([0.2418, *MID[1:]], abs=1e-9), "as rounded to whole pulses"
    assert handle.progress().fraction == 1.0
    bridge.close()
    told = [event for event in sent if not event.heartbeat]
    moves = wire.moves()
    assert len(told) == len(moves)
    for event, move in zip(told, moves, strict=True):
        assert [event.pulses_us[channel - 1] for channel in move.channels] == list(move.pulses_us)
        assert event.duration_ms == move.duration_ms
    assert [event.seq for event in sent] == list(range(1, len(sent) + 1))
    times = [event.robot_time_ns for event in sent]
    assert times == sorted(times)


def test_a_command_outside_the_limits_writes_nothing(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        before = len(wire.moves())
        with pytest.raises(LimitError) as caught:
            bridge.execute(Trajectory([10.0], [[*MID[:4], MID_M - 0.0451, MID_M]]), lease)
        assert caught.value.strut == "S5"
        with pytest.raises(LeaseError):
            bridge.execute(one_step(), "stolen")
        beat = bridge.snapshot().last_seq
        wait_for(lambda: bridge.snapshot().last_seq > beat + 4, "some heartbeats")
        assert len(wire.moves()) == before


def test_stop_in_motion_lets_no_further_motion_out(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wait_for(lambda: handle.progress().fraction > 0.05, "motion")
        bridge.stop()
        stopped_at = len(sent)
        assert sent[-1].kind == "hold"
        held, moved = sent[-1], [event for event in sent if event.kind == "move"]
        assert moved[-2].pulses_us[0] - 1 <= held.pulses_us[0] <= moved[-1].pulses_us[0], "where the board is"
        assert held.pulses_us[1:] == moved[-1].pulses_us[1:]
        assert bridge.snapshot().lengths_m == held.lengths_m
        result = handle.result()
        assert result is not None
        assert (result.outcome, result.reason) == (MotionOutcome.FAULT, "stop pressed")
        wait_for(lambda: len(sent) > stopped_at + 5, "heartbeats")
        assert all(event.heartbeat for event in sent[stopped_at:])
        assert wire.moves()[-1] == Move((1, 2, 3, 4, 5, 6), held.pulses_us, 55)
        with pytest.raises(FaultLatched, match="stop pressed"):
            bridge.arm("test", True)
        bridge.reset()
        assert bridge.snapshot().mode is Mode.DISARMED


def test_stop_while_homing_holds_only_what_has_power(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    bridge = make_bridge(wire.port, rules=replace(rules, pacing=Pacing(energise_pause_s=0.3)))
    bridge.open()
    bridge.arm("test", True, MID)
    wait_for(lambda: len(wire.moves()) >= 2, "two struts under power")
    bridge.stop()
    beat = bridge.snapshot().last_seq
    wait_for(lambda: bridge.snapshot().last_seq > beat + 4, "heartbeats")
    *energised, hold = wire.moves()
    assert hold.channels == tuple(move.channels[0] for move in energised)
    assert 2 <= len(hold.channels) < 6


def test_stop_does_not_wait_for_a_shape_that_is_being_judged(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    judging, release = threading.Event(), threading.Event()

    def slow(lengths_m: tuple[float, ...]) -> str | None:
        if lengths_m[0] > 0.24:
            judging.set()
            release.wait(20.0)
        return None

    bridge = make_bridge(wire.port, rules=replace(rules, shape_check=slow))
    bridge.open()
    with armed(bridge) as lease:
        refused: list[Exception] = []

        def command() -> None:
            try:
                bridge.execute(there_and_back(), lease)
            except FaultLatched as error:
                refused.append(error)

        thread = threading.Thread(target=command)
        thread.start()
        assert judging.wait(20.0)
        start = time.monotonic()
        bridge.stop()
        assert time.monotonic() - start < 1.0
        release.set()
        thread.join()
        assert refused


def test_cancel_holds_and_the_next_command_goes_on(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wait_for(lambda: handle.progress().fraction > 0.05, "motion")
        handle.cancel("enough")
        result = handle.result()
        assert result is not None
        assert (result.outcome, result.reason) == (MotionOutcome.HELD, "enough")
        assert 0.0 < handle.progress().fraction < 0.9
        assert bridge.snapshot().mode is Mode.HOLD
        again = bridge.execute(Trajectory([2.0], [MID]), lease)
        handle.cancel("too late")
        assert again.wait(20.0)
        assert bridge.snapshot().mode is Mode.ARMED


def test_a_motion_overtakes_another_without_a_frame_that_holds(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    with armed(bridge) as lease:
        one = bridge.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]), lease)
        wait_for(lambda: bridge.snapshot().lengths_m[0] > MID_M + 0.005, "a third of a centimetre")
        since = len(sent)
        other = bridge.execute(Trajectory([0.5], [[MID_M, MID_M - 0.01, *MID[2:]]]), lease, overtake=True)
        assert one.wait(5.0)
        with pytest.raises(LimitError, match="stroke"):
            bridge.execute(Trajectory([9.0], [[MID_M + 0.06, *MID[1:]]]), lease, overtake=True)
        assert other.result() is None, "the one that is refused ends nothing"
        assert other.wait(10.0)
    ended, outcome = one.result(), other.result()
    assert ended is not None
    assert outcome is not None
    assert (ended.outcome, ended.reason) == (MotionOutcome.OVERTAKEN, f"overtaken by motion {other.number}")
    assert outcome.outcome is MotionOutcome.DONE
    frames = [event for event in sent[since:] if not event.heartbeat]
    assert {event.kind for event in frames} == {"move"}
    lengths = np.array([event.lengths_m for event in frames])
    assert lengths[-1] == pytest.approx([MID_M, MID_M - 0.01, *MID[2:]], abs=1e-4)
    assert lengths[:, 0].argmax() > 0, "the old path is kept until the new one begins"
    assert np.abs(np.diff(lengths, axis=0)).max() <= 0.02 * 0.055 + 2e-4


def test_with_nothing_to_overtake_a_motion_begins_as_any(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        motion = bridge.execute(one_step(), lease, overtake=True)
        assert motion.wait(5.0)
        assert motion.result().success  # type: ignore[union-attr]


def test_a_judge_that_is_slower_than_the_lead_is_given_more(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    slow: list[tuple[float, ...]] = []
    slowness = threading.Event()

    def judge(lengths_m: tuple[float, ...]) -> str | None:
        if slowness.is_set():
            slow.append(lengths_m)
        if len(slow) == 1:
            began = bridge.snapshot().last_seq
            wait_for(lambda: bridge.snapshot().last_seq > began + 5, "more frames than fit into the lead")
        return None

    bridge = make_bridge(wire.port, rules=replace(rules, shape_check=judge))
    bridge.open()
    with armed(bridge) as lease:
        one = bridge.execute(Trajectory([2.5], [[MID_M + 0.03, *MID[1:]]]), lease)
        wait_for(lambda: bridge.snapshot().lengths_m[0] > MID_M + 0.003, "motion")
        slowness.set()
        other = bridge.execute(Trajectory([1.0], [[MID_M, MID_M - 0.01, *MID[2:]]]), lease, overtake=True)
        assert one.wait(5.0)
        assert one.result().outcome is MotionOutcome.OVERTAKEN  # type: ignore[union-attr]
        assert other.wait(10.0)


def test_a_silent_commander_is_held_within_the_limit(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    lease = bridge.arm("test", True, MID)
    wait_for(lambda: bridge.snapshot().mode is Mode.ARMED, "ARMED")
    bridge.prove(lease)
    handle = bridge.execute(there_and_back(), lease)
    assert handle.wait(20.0)
    result = handle.result()
    assert result is not None
    assert result.outcome is MotionOutcome.HELD
    moving = [event.robot_time_ns for event in sent if event.kind == "move"]
    assert moving[-1] - moving[0] < 1.3e9
    assert bridge.snapshot().mode is Mode.HOLD
    with pytest.raises(LeaseError):
        bridge.execute(one_step(), lease)
    assert wire.moves()[-1].pulses_us == sent[-1].pulses_us


# ---- memory ---------------------------------------------------------------------------------------------------------


def test_after_a_restart_the_last_pulses_are_known(make_bridge: Make, wire: Wire) -> None:
    first = make_bridge(wire.port)
    first.open()
    with pytest.raises(PositionUnknown, match="S1"):
        first.arm("test", True)
    with armed(first) as lease:
        assert first.execute(one_step(), lease).wait(20.0)
    first.close()
    second = make_bridge(wire.port)
    second.open()
    assert second.snapshot().lengths_m == pytest.approx([0.235, *MID[1:]])
    count = len(wire.moves())
    with armed(second, None):
        assert wire.moves()[count] == Move((1,), (1510,), 55)


def test_without_a_memory_nothing_arms(make_bridge: Make, wire: Wire, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    bridge = make_bridge(wire.port, state_dir=tmp_path / "file")
    bridge.open()
    with pytest.raises(StateFileError):
        bridge.arm("test", True, MID)
    assert bridge.snapshot().mode is Mode.DISARMED
    assert wire.moves() == []


# ---- the link -------------------------------------------------------------------------------------------------------


def test_a_lost_link_latches_and_reset_wants_it_back(make_bridge: Make, wire: Wire) -> None:
    sent: list[SentEvent] = []
    bridge = make_bridge(wire.port, on_sent=sent.append)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wait_for(lambda: handle.progress().fraction > 0.02, "motion")
        wire.cut()
        assert handle.wait(20.0)
    result = handle.result()
    assert result is not None
    assert result.outcome is MotionOutcome.FAULT
    snapshot = bridge.snapshot()
    assert (snapshot.mode, snapshot.link_ok) == (Mode.FAULT, False)
    assert wire.port in snapshot.reason
    count = len(sent)
    with pytest.raises(PortMissing):
        bridge.reset()
    assert bridge.snapshot().mode is Mode.FAULT
    bridge.stop()
    assert len(sent) == count, "no heartbeat without a link"


def test_a_board_that_answered_and_falls_silent_is_a_lost_link(make_bridge: Make) -> None:
    wire = Wire(answers=True)
    bridge = make_bridge(wire.port, liveness_period_s=0.05, liveness_limit_s=0.3)
    bridge.open()

    def heard() -> bool:
        wire.listen()
        return bridge.snapshot().battery_mv == 7400

    wait_for(heard, "a battery reply")
    wire.answers = False
    wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "FAULT")
    assert "not answered" in bridge.snapshot().reason
    wire.answers = True
    bridge.reset()
    wait_for(heard, "a battery reply after reset")
    assert bridge.snapshot().mode is Mode.DISARMED
    wire.cut()


def test_a_board_that_never_answers_is_not_missed(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port, liveness_period_s=0.05, liveness_limit_s=0.1)
    bridge.open()
    wait_for(lambda: len([frame for frame in wire.listen() if frame.command == CMD_BATTERY]) > 5, "queries")
    assert bridge.snapshot().mode is Mode.DISARMED


def test_a_port_that_takes_no_bytes_is_a_lost_link(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wire.fill()
        assert handle.wait(20.0)
    snapshot = bridge.snapshot()
    assert (snapshot.mode, snapshot.link_ok, snapshot.write_errors) == (Mode.FAULT, False, 1)
    assert "bytes in time" in snapshot.reason


def test_stop_does_not_hang_on_a_port_that_takes_no_bytes(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port, liveness_period_s=None)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wire.fill()
        start = time.monotonic()
        bridge.stop()
        assert time.monotonic() - start < 1.0
        assert handle.result() is not None
        assert bridge.snapshot().mode is Mode.FAULT


# ---- the stream -----------------------------------------------------------------------------------------------------


def test_faces_and_frames_are_one_stream_in_order(make_bridge: Make, wire: Wire) -> None:
    events: list[SentEvent | FaceEvent] = []
    bridge = make_bridge(wire.port, on_sent=events.append, on_face=events.append)
    bridge.open()

    def look() -> None:
        for _ in range(200):
            bridge.observe_face("TC6", "operator", True, "looked")

    threads = [threading.Thread(target=look) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_for(lambda: isinstance(events[-1], SentEvent), "a heartbeat after the faces")
    bridge.close()
    assert [event.seq for event in events] == list(range(1, len(events) + 1))
    times = [event.robot_time_ns for event in events]
    assert times == sorted(times)
    assert sum(isinstance(event, FaceEvent) for event in events) == 800


@pytest.mark.parametrize(("face", "source"), [("TC9", "operator"), ("tc1", "operator"), ("TC1", "predicted"), ("TC1", "")])
def test_only_observations_enter_the_stream(make_bridge: Make, wire: Wire, face: str, source: str) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with pytest.raises(ParameterError, match="valid is"):
        bridge.observe_face(face, source, True)
    assert bridge.observe_face("", "external", False).face == ""


def test_a_failing_callback_stops_nothing(make_bridge: Make, wire: Wire) -> None:
    calls: list[SentEvent] = []

    def fail(event: SentEvent) -> None:
        calls.append(event)
        raise RuntimeError("not the bridge's business")

    bridge = make_bridge(wire.port, on_sent=fail)
    bridge.open()
    wait_for(lambda: len(calls) > 5, "heartbeats")
    assert bridge.snapshot().mode is Mode.DISARMED


def test_closing_in_motion_holds_and_ends(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(), lease)
        wait_for(lambda: handle.progress().fraction > 0.02, "motion")
        bridge.close()
    assert handle.result() is not None
    *_, before, last, hold = wire.moves()
    assert before.pulses_us[0] - 1 <= hold.pulses_us[0] <= last.pulses_us[0]
    assert bridge.snapshot().mode is Mode.DISARMED
    bridge.close()


def test_a_bug_while_sending_latches_and_holds_where_the_board_is(
    make_bridge: Make, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(rules: Rules, struts: object, pulses_us: tuple[int, ...], *rest: object) -> None:
        if pulses_us[0] > 1520:
            raise ZeroDivisionError

    monkeypatch.setattr("hardware_bridge.driver.engine.check_frame", broken)
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(Trajectory([0.977], [[MID_M + 0.01, *MID[1:]]]), lease)
        assert handle.wait(20.0)
    assert bridge.snapshot().mode is Mode.FAULT
    assert "ZeroDivisionError" in bridge.snapshot().reason
    *_, before, last, hold = wire.moves()
    assert before.pulses_us[0] - 1 <= hold.pulses_us[0] <= last.pulses_us[0] <= 1520


def test_a_frame_far_from_all_judged_shapes_holds_without_a_fault(
    make_bridge: Make, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    def astray(rules: Rules, struts: object, pulses_us: tuple[int, ...], *rest: object) -> None:
        if pulses_us[0] > 1520:
            pulses_us = (*pulses_us[:5], pulses_us[5] - 10)
        check_frame(rules, struts, pulses_us, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("hardware_bridge.driver.engine.check_frame", astray)
    bridge = make_bridge(wire.port)
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(Trajectory([0.977], [[MID_M + 0.01, *MID[1:]]]), lease)
        assert handle.wait(20.0)
        assert bridge.snapshot().mode is Mode.HOLD
        assert "nobody has judged it" in bridge.snapshot().reason
        assert max(move.pulses_us[0] for move in wire.moves()) <= 1520


def test_the_frame_loop_never_waits_for_the_judge(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    judges: list[str] = []

    def judge(lengths_m: tuple[float, ...]) -> str | None:
        judges.append(threading.current_thread().name)
        beat = bridge.snapshot().last_seq
        wait_for(lambda: bridge.snapshot().last_seq > beat, "a heartbeat while a shape is judged")
        return None

    bridge = make_bridge(wire.port, rules=replace(rules, shape_check=judge))
    bridge.open()
    with armed(bridge) as lease:
        with suppress(StaleError):  # eleven heartbeats take about as long as a stamp is good for
            bridge.execute(Trajectory([1.0], [[MID_M + 0.01, *MID[1:]]]), lease).cancel()
        assert judges == [threading.current_thread().name] * 11, "neutral, and ten shapes a mm apart"


def test_a_command_that_took_long_to_judge_is_too_old_and_is_accepted_when_sent_again(
    make_bridge: Make, wire: Wire, rules: Rules
) -> None:
    limits = Limits(goal_age_s=0.05)
    asked: list[tuple[float, ...]] = []

    def slow(lengths_m: tuple[float, ...]) -> None:
        asked.append(lengths_m)
        if len(asked) == 5:  # the first is neutral, judged for homing
            began = bridge.snapshot().last_seq
            wait_for(lambda: bridge.snapshot().last_seq > began + 3, "three heartbeats, 150 ms")

    bridge = make_bridge(wire.port, rules=replace(rules, limits=limits, shape_check=slow))
    bridge.open()
    with armed(bridge) as lease:
        moves = len(wire.moves())
        with pytest.raises(StaleError, match="send it again") as caught:
            bridge.execute(there_and_back(), lease)
        assert caught.value.age_s > 0.1
        assert len(wire.moves()) == moves
        with pytest.raises(LimitError, match="speed"):  # what is wrong comes before what is old
            bridge.execute(there_and_back(0.03, 0.5), lease, stamp_age_s=10.0)
        asked_before, accepted = len(asked), False
        for _ in range(20):  # a busy machine may need 50 ms for anything
            with suppress(StaleError):
                bridge.execute(there_and_back(), lease)
                accepted = True
                break
        assert accepted
        assert len(asked) == asked_before, "what was judged is remembered"


def test_homing_through_a_bad_shape_is_refused(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    bridge = make_bridge(wire.port, rules=replace(rules, shape_check=lambda shape: "thin ice" if shape[0] < 0.2 else None))
    bridge.open()
    with pytest.raises(ShapeError, match="thin ice"):
        bridge.arm("test", True, (0.195, *MID[1:]))
    assert bridge.snapshot().mode is Mode.DISARMED
    assert not wire.moves()


def test_only_the_holder_makes_the_judge_work(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    judged: list[tuple[float, ...]] = []
    bridge = make_bridge(wire.port, rules=replace(rules, shape_check=judged.append))
    bridge.open()
    with armed(bridge):
        before = len(judged)
        with pytest.raises(LeaseError):
            bridge.execute(there_and_back(), "stolen")
        assert len(judged) == before


# ---- duty and supply ------------------------------------------------------------------------------------------------


def test_a_spent_duty_budget_refuses_the_way_out_and_not_the_way_back(make_bridge: Make, wire: Wire, rules: Rules) -> None:
    tight = replace(rules, limits=Limits(duty_window_s=10.0))
    bridge = make_bridge(wire.port, rules=tight)
    bridge.open()
    with armed(bridge) as lease:
        assert bridge.snapshot().duty_left_s == pytest.approx(2.0)
        assert bridge.execute(Trajectory([1.6], [[MID_M + 0.02, *MID[1:]]]), lease).wait(20.0)
        with pytest.raises(DutyError, match=r"S1: has run 1\.\d s of the last 10 s .* the limit is 2 s; wait \d+ s") as caught:
            bridge.execute(Trajectory([1.0], [[MID_M + 0.03, *MID[1:]]]), lease)
        assert caught.value.wait_s is not None
        assert 6.0 < caught.value.wait_s < 11.0
        assert bridge.execute(Trajectory([1.6], [MID]), lease).wait(20.0)
        assert bridge.snapshot().duty_left_s == 0.0


def test_a_low_supply_refuses_the_way_out_and_not_the_way_back(make_bridge: Make, rules: Rules) -> None:
    wire = Wire(answers=True)
    bridge = make_bridge(wire.port, rules=replace(rules, limits=Limits(supply_low_v=7.5)), liveness_period_s=0.05)
    bridge.open()
    with armed(bridge) as lease:
        wait_for(lambda: bool(wire.listen()) and bridge.snapshot().battery_mv == 7400, "the board's answer")
        with pytest.raises(SupplyError, match=r"servo supply is 7\.40 V, the limit is 7\.5 V"):
            bridge.execute(one_step(), lease)
        assert bridge.execute(Trajectory([0.1], [MID]), lease).wait(20.0)
    bridge.close()
    wire.cut()
