"""The bridge's inside: does what the supervisor says, and keeps the numbered stream of what really happened.

One lock orders everything: an event for the supervisor, the bytes it leads to, the number (``seq``) and robot time of
the events, and their callbacks.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from hardware_bridge.calibration import STRUTS
from hardware_bridge.checks import Rules, check_frame
from hardware_bridge.clock import RobotClock
from hardware_bridge.codecs import Board
from hardware_bridge.congestion import Congestion
from hardware_bridge.duty_record import DutyRecord
from hardware_bridge.errors import BridgeError, LinkLost, ShapeError
from hardware_bridge.events import Callbacks, FaceEvent, SentEvent, Snapshot
from hardware_bridge.health import Answer, judge
from hardware_bridge.last_pulses import LastPulses
from hardware_bridge.latency import Latency
from hardware_bridge.link import Link
from hardware_bridge.motion import MotionHandle, MotionResult, Progress
from hardware_bridge.protocol import (
    HOMING_NUMBER,
    Event,
    Fail,
    Finished,
    Hold,
    Kind,
    Mode,
    Refuse,
    Reset,
    Send,
    State,
    Supply,
    Tick,
)
from hardware_bridge.protocol import LinkLost as LinkLostEvent
from hardware_bridge.supervisor import Supervisor

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
    """Supervisor, board and link under one lock; all but ``tick``, ``snapshot`` and ``barred`` are called with it held.

    Attributes:
        lock: The lock.
        link: The port with its board.
        clock: Robot time.
        state: The supervisor's state.
        virtual: Whether the port is the virtual prototype's.
        prototype: Its instance; empty on a real port.
    """

    def __init__(self, port: str, rules: Rules, board: Board, link: Link, callbacks: Callbacks) -> None:
        self.lock = threading.RLock()
        self.link = link
        self.clock = RobotClock()
        self.state = State()
        self.virtual = False
        self.prototype = ""
        self._port = port
        self._rules = rules
        self._board = board
        self._callbacks = callbacks
        self._supervisor = Supervisor(rules, board.quirks.duration_ms[0])
        self._record: LastPulses | None = None
        self._duty_record: DutyRecord | None = None
        self._motions: dict[int, MotionHandle] = {}
        self._count = _Counters()
        self._latency = Latency()
        self._written_in_tick = False
        self._congestion = Congestion()
        self._board_errors: tuple[str, ...] = ()
        self._told: tuple[object, ...] = ()
        self._bars = 0
        self._bars_lock = threading.Lock()

    # ---- life -------------------------------------------------------------------------------------------------------

    def begin(self, time_scale: float, record: LastPulses, virtual: bool) -> None:
        """A new stream on a port just opened: clock at 0, ``seq`` from 1. A latched fault stays."""
        was = self.state
        duty = was.duty.moved_by(-self.clock.now().robot_s)
        self.clock = RobotClock(time_scale)
        self.state = State(duty=duty)
        if was.mode is Mode.FAULT:
            self.state = replace(self.state, mode=Mode.FAULT, reason=was.reason)
        self._count, self._latency, self._congestion = _Counters(), Latency(), Congestion()
        self._board_errors = ()
        self.link.begin_counting()
        self.use_record(record, virtual)
        if not duty.spells and self._duty_record is not None:
            loaded = self._duty_record.load(self.clock.now().robot_s, time_scale, self._rules.limits)
            self.state = replace(self.state, duty=loaded)
        self._heartbeat()
        self.tell_state(force=True)

    def use_record(self, record: LastPulses, virtual: bool) -> None:
        """Takes the last pulses from the record of the robot behind the port."""
        self._record, self.virtual = record, virtual
        self._duty_record = DutyRecord(record.path.parent, self._port, record.robot)
        self.state = replace(self.state, pulses_us=record.load(self._rules.calibration.channels))

    def reopened(self) -> None:
        """Counts a lost link that was opened again."""
        self._count.reopened += 1

    def save_record(self, durable: bool = False) -> None:
        """Writes the records anew. Raises :class:`StateFileError`."""
        assert self._record is not None
        assert self._duty_record is not None
        self._duty_record.save(self.state.duty, self.clock.now().robot_s, force=True)
        self._record.save(self._rules.calibration.channels, self.state.pulses_us, force=True, durable=durable)

    # ---- time -------------------------------------------------------------------------------------------------------

    def tick(self, missed: int) -> None:
        """One period: replies, lease, motion; a heartbeat if nothing was written. ``missed`` periods are lost."""
        with self.lock:
            self._count.late_periods += missed
            self._written_in_tick = False
            congested = False
            if self.link.is_up:
                try:
                    now_s = self.clock.now().wall_s
                    answer = self.link.attend(now_s, self.state.energised)
                    if answer is not None:
                        self._judge(answer)
                    if self.link.battery_mv != self.state.supply_mv:
                        self.apply(Supply(self.link.battery_mv))
                    congested = self._congestion.look(self.link, now_s)
                except LinkLost as error:
                    self.apply(LinkLostEvent(str(error)))
            if not self._is_barred:
                self.apply(Tick(congested))
            if self.link.is_up and not self._written_in_tick:
                self._heartbeat()
            if self._duty_record is not None:
                self._duty_record.try_to_save(self.state.duty, self.clock.now().robot_s)

    def tick_failed(self, error: Exception) -> None:
        """The frame loop has a bug: latches."""
        with self.lock:
            self.apply(Fail(f"internal error in the frame loop: {error}"))

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
            LinkLost: It has lost or moved struts that hold; the link is down, so nothing is sent to where they were.
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
        self.state = replace(self.state, pulses_us=(None,) * len(STRUTS), energised=(False,) * len(STRUTS))
        try:
            self.save_record()
        except BridgeError as error:  # it is tried again by arm, which then fails
            _log.error("%s", error)

    # ---- the supervisor's effects -----------------------------------------------------------------------------------

    def apply(self, event: Event) -> None:
        """Takes the supervisor one step and does what it says. Raises what it refuses."""
        before = self.state
        if isinstance(event, Reset):
            self._board_errors = ()
        self.state, effects = self._supervisor.step(before, event, self.clock.now())
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
        for effect in effects:
            if isinstance(effect, Refuse):
                raise effect.error

    def _send(self, send: Send, before: State) -> Event | None:
        """One frame through the last gate to the port; what went wrong, if anything."""
        channels = self._rules.calibration.channels
        if not self.link.is_up or (send.kind in _MOVING and self._is_barred):
            self._unsend(before)
            return None
        homing = send.kind is not Kind.MOVE
        try:
            check_frame(self._rules, send.struts, send.pulses_us, before.pulses_us, send.duration_ms, homing)
            frame = self._frame(send)
            assert self._record is not None
            self._record.save(channels, self.state.pulses_us)
            begun_s = time.monotonic()
            self.link.write(frame)
            self._latency.add(time.monotonic() - begun_s)
        except LinkLost as error:
            return LinkLostEvent(str(error))
        except Exception as error:
            self._unsend(before)
            if isinstance(error, ShapeError):  # between two shapes that were judged when the motion was accepted
                return Hold(f"held before a frame: {error}")
            if isinstance(error, BridgeError):
                return Fail(f"frame not sent: {error}")
            _log.exception("sending a frame")
            return Fail(f"frame not sent, internal error: {error!r}")
        self._count.frames_sent += 1
        self._written_in_tick = True
        self._emit_sent(send.kind, send.duration_ms, frame)
        return None

    def _frame(self, send: Send) -> bytes:
        calibration, newest = self._rules.calibration, self.state.last_frame
        pulses_us = [send.pulses_us[index] for index in send.struts]
        channels = [calibration.channels[index] for index in send.struts]
        if send.kind is Kind.HOLD:
            return self._board.encode_hold(pulses_us, channels)
        from_us = send.pulses_us if newest is None else calibration.pulses_us(newest.from_m)
        return self._board.encode_move(pulses_us, channels, send.duration_ms, [from_us[index] for index in send.struts])

    def _unsend(self, before: State) -> None:
        """The frame that the supervisor counted as sent was not."""
        self.state = replace(self.state, pulses_us=before.pulses_us, energised=before.energised)

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
            motion, result = self.state.motion, handle.result()
            if motion is not None and motion.number == handle.number:
                handle.sent_s = motion.progress_s
            elif result is not None and result.success:
                handle.sent_s = handle.duration_s
            fraction = 1.0 if handle.duration_s == 0 else handle.sent_s / handle.duration_s
            return Progress(fraction, handle.sent_s, handle.duration_s, self.lengths_m())

    # ---- the stream -------------------------------------------------------------------------------------------------

    def emit_face(self, face: str, source: str, settled: bool, detail: str) -> FaceEvent:
        """Numbers a face observation into the stream."""
        event = FaceEvent(*self._number(), face, source, settled, detail)
        self._callbacks.face(event)
        return event

    def tell_state(self, force: bool = False) -> None:
        """Calls ``on_state`` if anything that it is about has changed."""
        state = self.state
        token = None if state.lease is None else state.lease.token
        moving = None if state.motion is None else state.motion.number
        now = (state.mode, state.reason, token, state.homed, moving, self.link.is_up)
        if force or now != self._told:
            self._told = now
            self._callbacks.state(self.snapshot())

    def snapshot(self) -> Snapshot:
        """Everything at this instant."""
        with self.lock:
            state, count = self.state, self._count
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
                virtual_port=self.virtual,
                prototype=self.prototype,
                time_scale=self.clock.time_scale,
                lengths_m=self.lengths_m(),
                known=self._known(),
                energised=state.energised,
                calibration_hash=self._rules.calibration.hash,
                battery_mv=self.link.battery_mv,
                duty_left_s=state.duty.left_s(self.clock.now().robot_s, self._rules.limits),
                frames_sent=count.frames_sent,
                write_errors=self.link.write_errors,
                late_periods=count.late_periods,
                congested_periods=self._congestion.periods,
                duty_limit_s=self._rules.limits.duty_s,
                supply_low_v=self._rules.limits.supply_low_v,
                write_latency=self._latency.percentiles(),
                reopened=count.reopened,
                board_errors=self._board_errors,
                replies=self.link.replies,
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
        )
        self._callbacks.sent(event)

    def _number(self) -> tuple[int, int]:
        self._count.seq += 1
        self._count.robot_time_ns = max(self._count.robot_time_ns, self.clock.now_ns())
        return self._count.seq, self._count.robot_time_ns
