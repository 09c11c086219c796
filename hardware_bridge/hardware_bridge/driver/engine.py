# SPDX-License-Identifier: Apache-2.0
"""The bridge's inside: does what the supervisor says, and keeps the numbered stream of what really happened.

One lock orders everything: an event for the supervisor, the bytes it leads to, the number (`seq`) and robot time of
the events, and their callbacks.
"""

import logging
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from hardware_bridge.boards.board import Board
from hardware_bridge.driver.events import Callbacks, FaceEvent, SentEvent, Snapshot
from hardware_bridge.driver.motion_handle import MotionHandle, MotionResult, Progress
from hardware_bridge.driver.robot_clock import RobotClock
from hardware_bridge.errors import BridgeError, LinkLost, ShapeError, StateFileError
from hardware_bridge.link.board_health import Answer, judge
from hardware_bridge.link.board_link import Link
from hardware_bridge.link.latency import Latency
from hardware_bridge.safety.board_position import BoardTrack
from hardware_bridge.safety.limit_checks import Rules, check_frame
from hardware_bridge.safety.supervisor import Supervisor
from hardware_bridge.safety.supervisor_messages import (
    HOMING_NUMBER,
    NONE_ENERGISED,
    NONE_KNOWN,
    Event,
    Finished,
    Hold,
    Kind,
    LinkDown,
    Mode,
    Reset,
    Send,
    State,
    Stop,
    Supply,
    Tick,
)
from hardware_bridge.saved_state.robot_records import Records

_log = logging.getLogger(__name__)
_MOVING = (Kind.ENERGISE, Kind.HOME, Kind.MOVE)


@dataclass
class _Counters:
    seq: int = 0
    robot_time_ns: int = 0
    frames_sent: int = 0
    late_periods: int = 0
    reopened: int = 0


class Engine:
    """Supervisor, board and link under one lock; all but `tick`, `snapshot` and `barred` are called with it held.

    Attributes:
        lock: the lock.
        link: the port with its board.
        clock: robot time.
        state: the supervisor's state.
        session: identity of this stream of events, new with every `begin`; empty before the first.
        prototype: instance of the virtual prototype behind the port; empty on a real one.
    """

    def __init__(self, port: str, rules: Rules, board: Board, link: Link, callbacks: Callbacks) -> None:
        self.lock = threading.RLock()
        self.link = link
        self.clock = RobotClock()
        self.state = State()
        self.session = ""
        self.prototype = ""
        self._port = port
        self._rules = rules
        self._board = board
        self._callbacks = callbacks
        self._supervisor = Supervisor(rules, board.move_time_s)
        self._track = BoardTrack(board.move_time_s)
        self._applied_s = 0.0
        self._records: Records | None = None
        self._motions: dict[int, MotionHandle] = {}
        self._count = _Counters()
        self._latency = Latency()
        self._written_in_tick = False
        self._board_errors: tuple[str, ...] = ()
        self._told: tuple[object, ...] = ()
        self._bars = 0
        self._bars_lock = threading.Lock()

    # ---- life -------------------------------------------------------------------------------------------------------

    def begin(self, time_scale: float, records: Records, rested_s: float = 0.0) -> None:
        """A new stream on a port just opened: clock at 0, `seq` from 1. A latched fault stays."""
        self.session = secrets.token_hex(8)
        was = self.state
        self.clock = RobotClock(time_scale)
        self.state = State()
        if was.mode is Mode.FAULT:
            self.state = replace(self.state, mode=Mode.FAULT, reason=was.reason)
        self._count, self._latency = _Counters(), Latency()
        self._board_errors = ()
        self.link.begin_counting()
        self._records = None
        self.use_records(records, rested_s)
        self._heartbeat()
        self.tell_state(force=True)

    def use_records(self, records: Records, rested_s: float = 0.0) -> None:
        """Takes from them what is known of the robot behind the port; of the same one as before, memory knows more."""
        self._track.forget()
        self.state = replace(self.state, last_frame=None)
        if records is self._records:
            return
        self._records = records
        pulses_us = records.pulses.load(self._rules.calibration.channels)
        duty = records.duty.load(self.clock.now().robot_s, self.clock.time_scale, rested_s)
        self.state = replace(self.state, pulses_us=pulses_us, unknown_why=records.pulses.why, duty=duty)

    def reopened(self) -> None:
        """Counts a lost link that was opened again."""
        self._count.reopened += 1

    def save_record(self, durable: bool = False) -> None:
        """Writes the records anew. Raises `StateFileError`."""
        assert self._records is not None
        self._records.duty.save(self.state.duty, self.clock.now().robot_s, force=True)
        self._records.pulses.save(self._rules.calibration.channels, self.state.pulses_us, force=True, durable=durable)

    # ---- time -------------------------------------------------------------------------------------------------------

    def tick(self, missed: int) -> None:
        """One period: replies, lease, motion; a heartbeat if nothing was written. `missed` periods are lost."""
        with self.lock:
            self._count.late_periods += missed
            self._written_in_tick = False
            congested = False
            if self.link.is_up:
                try:
                    now_s = self.clock.now().wall_s
                    congested = self.link.holds_back(now_s)  # before a question is put behind the last frame
                    answer = self.link.attend(now_s, self.state.energised)
                    if answer is not None:
                        self._judge(answer)
                    if self.link.battery_mv != self.state.supply_mv:
                        self.apply(Supply(self.link.battery_mv))
                except LinkLost as error:
                    self.apply(LinkDown(str(error)))
            if not self._is_barred:
                self.apply(Tick(congested))
            if self.link.is_up and not self._written_in_tick:
                self._heartbeat()
            if self._records is not None:
                self._records.duty.try_to_save(self.state.duty, self.clock.now().robot_s)

    def tick_failed(self, error: Exception) -> None:
        """The frame loop has a bug: latches."""
        with self.lock:
            self.apply(Stop(f"internal error in the frame loop: {error}"))

    @contextmanager
    def barred(self) -> Iterator[None]:
        """Inside, no frame that moves anything is begun, whoever holds the lock."""
        with self._bars_lock:
            self._bars += 1
        try:
            yield
        finally:
            with self._bars_lock:
                self._bars -= 1

    @property
    def _is_barred(self) -> bool:
        return self._bars > 0

    # ---- the board's answers ----------------------------------------------------------------------------------------

    def _judge(self, answer: Answer) -> None:
        """Draws the conclusions from what the board says of itself.

        Raises:
            LinkLost: it has lost or moved struts that hold; the link is down, so nothing is sent to where they were.
        """
        holds = self.state.mode not in (Mode.DISARMED, Mode.FAULT) or any(self.state.energised)
        verdict = judge(answer, holds, self._board.quirks.error_moves)
        self._board_errors = answer.health.errors or self._board_errors
        if verdict.positions_unknown:
            _log.warning("%s: nobody knows where the struts are", ", ".join(answer.health.errors) or "no pulse")
            self.forget_positions()
        if verdict.problem:
            remedy = "see where each strut is, check supply and wiring, then reset and arm with confirmed lengths"
            raise self.link.lost(verdict.problem, remedy)

    def forget_positions(self) -> None:
        """Nobody knows any more where the struts are: the next arm needs the operator's word for each."""
        self._track.forget()
        why = "the board may have moved or released the struts since they were sent"
        self.state = replace(self.state, pulses_us=NONE_KNOWN, energised=NONE_ENERGISED, last_frame=None, unknown_why=why)
        try:
            assert self._records is not None
            self._records.pulses.forget(self._rules.calibration.channels)
        except BridgeError as error:  # it is tried again by arm, which then fails
            _log.error("%s", error)

    # ---- the supervisor's effects -----------------------------------------------------------------------------------

    def apply(self, event: Event) -> None:
        """Takes the supervisor one step and does what it says. Raises what it refuses."""
        before = self.state
        if isinstance(event, Reset):
            self._board_errors = ()
        now = self.clock.now()
        self._applied_s = now.robot_s
        self.state, effects = self._supervisor.step(before, event, now)
        failure: Event | None = None
        for effect in effects:
            match effect:
                case Send():
                    failure = self._send(effect, before) or failure
                case Finished():
                    self._finish(effect)
        if failure is not None:
            self.apply(failure)
        self.tell_state()

    def _send(self, send: Send, before: State) -> Event | None:
        """One frame through the last gate to the port; what went wrong, if anything."""
        channels, hold, now_s = self._rules.calibration.channels, send.kind is Kind.HOLD, self._applied_s
        if not self.link.is_up or (send.kind in _MOVING and self._is_barred):
            self._unsend(before)
            return None
        try:
            if hold:
                send = self._permitted_hold(send, before)
            else:
                homing, at_us = send.kind is not Kind.MOVE, self._track.at_us(now_s)
                check_frame(self._rules, send.struts, send.pulses_us, before.pulses_us, send.duration_ms, homing, at_us)
            frame = self._frame(send)
            assert self._records is not None
            try:
                self._records.pulses.save(channels, self.state.pulses_us)
            except StateFileError as error:
                if not hold:
                    raise
                _log.error("%s", error)  # what is held is within a frame of what was kept last
            begun_s = time.monotonic()
            self.link.write(frame)
            self._latency.add(time.monotonic() - begun_s)
        except LinkLost as error:
            return LinkDown(str(error))
        except Exception as error:
            self._unsend(before)
            if hold:  # another one would fail too
                _log.exception("holding the struts")
                return LinkDown(str(self.link.lost(f"the struts could not be held: {error!r}")))
            if isinstance(error, ShapeError):  # between two shapes that were judged when the motion was accepted
                return Hold(f"held before a frame: {error}")
            if isinstance(error, BridgeError):
                return Stop(f"frame not sent: {error}")
            _log.exception("sending a frame")
            return Stop(f"frame not sent, internal error: {error!r}")
        self._track.sent(send.struts, send.pulses_us, send.duration_ms, now_s)
        self._count.frames_sent += 1
        self._written_in_tick = True
        self._emit_sent(send.kind, send.duration_ms, frame)
        return None

    def _permitted_hold(self, send: Send, before: State) -> Send:
        """The hold as the supervisor wants it; should the last gate find it elsewhere than the board, where the gate has it."""
        at_us = self._track.at_us(self._applied_s)
        try:
            check_frame(self._rules, send.struts, send.pulses_us, before.pulses_us, send.duration_ms, True, at_us, True)
        except Exception:
            _log.exception("a hold is not where the board is; the last gate's own is sent")
            held = [pulse if at is None else round(at) for pulse, at in zip(send.pulses_us, at_us, strict=True)]
            known = [None if was is None else pulse for pulse, was in zip(held, self.state.pulses_us, strict=True)]
            self.state = replace(self.state, pulses_us=tuple(known), last_frame=None)
            return replace(send, pulses_us=tuple(held))
        return send

    def _frame(self, send: Send) -> bytes:
        pulses_us = [send.pulses_us[index] for index in send.struts]
        channels = [self._rules.calibration.channels[index] for index in send.struts]
        if send.kind is Kind.HOLD:
            return self._board.encode_hold(pulses_us, channels, send.duration_ms)
        at_us = self._track.at_us(self._applied_s)
        from_us = [send.pulses_us[index] if (at := at_us[index]) is None else at for index in send.struts]
        return self._board.encode_move(pulses_us, channels, send.duration_ms, from_us)

    def _unsend(self, before: State) -> None:
        """The frame that the supervisor counted as sent was not: what was known of the board is true still."""
        self.state = replace(
            self.state,
            pulses_us=before.pulses_us,
            energised=before.energised,
            last_frame=before.last_frame,
            duty=before.duty,
            ticked_s=before.ticked_s,
            motion=before.motion if self.state.motion is not None else None,
            energising=before.energising if self.state.mode is before.mode else self.state.energising,
        )

    # ---- motions ----------------------------------------------------------------------------------------------------

    def add_motion(self, number: int, duration_s: float) -> MotionHandle:
        """The handle of the motion that the supervisor has just accepted."""
        handle = MotionHandle(number, duration_s, self._progress, self._cancel)
        self._motions[number] = handle
        return handle

    def _finish(self, finished: Finished) -> None:
        handle = self._motions.pop(finished.number, None)
        if handle is not None:
            handle.finish(MotionResult(finished.outcome, finished.reason, self.lengths_m()))

    def _cancel(self, number: int, reason: str) -> None:
        with self.lock:
            self.apply(Hold(reason, number))

    def _progress(self, handle: MotionHandle) -> Progress:
        with self.lock:
            motion = self.state.motion
            runs = motion is not None and motion.number == handle.number
            return handle.progress_at(motion.progress_s if motion is not None and runs else None, self.lengths_m())

    # ---- the stream -------------------------------------------------------------------------------------------------

    def emit_face(self, face: str, source: str, settled: bool, detail: str) -> FaceEvent:
        """Numbers a face observation into the stream."""
        event = FaceEvent(*self._number(), face, source, settled, detail, self.session, time.time_ns())
        self._callbacks.tell(event)
        return event

    def tell_state(self, force: bool = False) -> None:
        """Calls `on_state` if anything that it is about has changed."""
        state = self.state
        token = None if state.lease is None else state.lease.token
        moving = None if state.motion is None else state.motion.number
        now = (state.mode, state.reason, token, state.homed, moving, self.link.is_up)
        if force or now != self._told:
            self._told = now
            self._callbacks.tell(self.snapshot())

    def snapshot(self) -> Snapshot:
        """Everything at this instant."""
        with self.lock:
            state, count, now_s = self.state, self._count, self.clock.now().robot_s
            return Snapshot(
                robot_time_ns=max(count.robot_time_ns, self.clock.now_ns()),
                last_seq=count.seq,
                mode=state.mode,
                reason=state.reason,
                lease_holder="" if state.lease is None else state.lease.holder,
                homed=state.homed,
                moving=state.motion is not None and state.motion.number != HOMING_NUMBER,
                port=self._port,
                link_ok=self.link.is_up,
                virtual_port=bool(self.prototype),
                prototype=self.prototype,
                time_scale=self.clock.time_scale,
                lengths_m=self.lengths_m(),
                known=self._known(),
                energised=state.energised,
                calibration_hash=self._rules.calibration.hash,
                robot=self._rules.calibration.robot or "",
                answered=self.link.has_answered,
                duty_known=state.duty.is_known(now_s, self._rules.limits),
                battery_mv=self.link.battery_mv,
                duty_left_s=state.duty.left_s(now_s, self._rules.limits),
                frames_sent=count.frames_sent,
                write_errors=self.link.write_errors,
                late_periods=count.late_periods,
                congested_periods=self.link.congested_periods,
                duty_limit_s=min(budget_s for _, budget_s in self._rules.limits.duty_windows),
                supply_low_v=self._rules.limits.supply_low_v,
                write_latency=self._latency.percentiles(),
                reopened=count.reopened,
                board_errors=self._board_errors,
                replies=self.link.replies,
                session=self.session,
            )

    def lengths_m(self) -> tuple[float, ...]:
        """Rest lengths last sent or confirmed, in [m]; mid stroke where nobody knows."""
        calibration = self._rules.calibration
        return tuple(
            calibration.mid_stroke_length_m if pulse is None else calibration.length_m(index, pulse)
            for index, pulse in enumerate(self.state.pulses_us)
        )

    def _known(self) -> tuple[bool, ...]:
        return tuple(pulse is not None for pulse in self.state.pulses_us)

    def _heartbeat(self) -> None:
        self._emit_sent(None, 0, b"")

    def _emit_sent(self, kind: Kind | None, duration_ms: int, frame: bytes) -> None:
        event = SentEvent(
            *self._number(),
            heartbeat=kind is None,
            lengths_m=self.lengths_m(),
            known=self._known(),
            pulses_us=tuple(pulse or 0 for pulse in self.state.pulses_us),
            duration_ms=duration_ms,
            frame=frame,
            kind="heartbeat" if kind is None else str(kind),
            session=self.session,
            wall_ns=time.time_ns(),
        )
        self._callbacks.tell(event)

    def _number(self) -> tuple[int, int]:
        self._count.seq += 1
        self._count.robot_time_ns = max(self._count.robot_time_ns, self.clock.now_ns())
        return self._count.seq, self._count.robot_time_ns
