# SPDX-License-Identifier: Apache-2.0
"""The bridge: one port, one board, one supervisor, one stream of events."""

from __future__ import annotations

import logging
import math
import secrets
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from hardware_bridge.boards.board import Board
from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.boards.maestro import timeout_s
from hardware_bridge.driver.engine import Engine
from hardware_bridge.driver.events import FACES, SOURCES, Callbacks, FaceEvent, SentEvent, Snapshot
from hardware_bridge.driver.frame_timer import Streamer
from hardware_bridge.driver.motion_handle import MotionHandle
from hardware_bridge.errors import ParameterError, Refused, StateError, TrajectoryError, WrongPrototype
from hardware_bridge.link.board_link import Link
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.prototype_client.handshake import Handshake, agree_on_board, agree_on_time_scale, examine, require_same_pty
from hardware_bridge.safety.command_age import Age
from hardware_bridge.safety.compatibility import require_fit
from hardware_bridge.safety.duty_cycle import returns
from hardware_bridge.safety.homing import homing_path, known_pulses
from hardware_bridge.safety.limit_checks import SHAPE_STEP_M, Rules, check_homing, check_trajectory
from hardware_bridge.safety.overtaking import joined, paced
from hardware_bridge.safety.shape_cache import ShapeMemory
from hardware_bridge.safety.supervisor_messages import NONE_KNOWN, Arm, Disarm, Execute, Hold, Mode, Overtake, Prove, Reset, Stop
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.saved_state.robot_identity import identity_of
from hardware_bridge.saved_state.robot_records import Records
from hardware_bridge.saved_state.state_file import state_directory
from sim_core.printable import NAME_MOST, printable

_log = logging.getLogger(__name__)

LEAD_S = 0.2
"""Wall time from the asking for a motion that overtakes another to its beginning: meanwhile its shapes are judged."""
MOST_LEAD = 8
"""A computer that needs so many times longer is too slow for it."""


class Bridge:
    """Drives six struts through a servo board. Every public method may be called from any thread.

    One lock orders everything: a call, the bytes it writes, the number (`seq`) and robot time of its events, and
    their callbacks, so callbacks come in the order of `seq`. They must therefore be short and must not call the
    bridge; an exception in one is logged and goes no further. `stop` does not wait for its turn to stop frames: it
    bars them at once, so at most the one frame that is already being written goes out after the call.

    Args:
        port: path, or `socket://HOST:PORT`.
        rules: calibration, limits, pacing and shape check (a function of six rest lengths in m that returns what is wrong, or
            the struts' axial forces in N, or None). It may be slow: it is asked once a shape, in the caller's thread and outside
            the lock, before a command is judged; the supervisor and the frame loop look its verdicts up.
        board: what sits behind the port; LSC by default.
        baud: rate between radio and board; None: the board's usual one.
        time_scale: robot seconds per second; None takes the virtual prototype's, or 1 on a real port.
        state_dir: where last pulses and running time are kept; by default `$SIXSTRUT_STATE_DIR` or `~/.local/state/sixstrut`.
        liveness_period_s: wall time between liveness queries; None asks never.
        liveness_limit_s: longest wall time without a reply, once the board has ever replied, before the link is lost.
        rested_s: the operator's word at the first opening: for so long the actuators have rested, in [s] of robot time. Where
            nobody knows how long they ran lately, that counts as spent for a window of duty, less this.
        silent_board: the operator's word that this board cannot answer. Without it, one that has not is not armed.
        on_sent: called with every `SentEvent`: each write that moves or holds, and one heartbeat each period (50 ms of robot time
            by default) without one, while the link is up.
        on_face: called with every `FaceEvent`.
        on_state: called with a `Snapshot` on every change of mode, reason, holder, motion or link.

    Raises:
        BoardMismatch, ParameterError: board, calibration, baud and frame period do not go together.
    """

    def __init__(
        self,
        port: str,
        rules: Rules,
        *,
        board: Board | None = None,
        baud: int | None = None,
        time_scale: float | None = None,
        state_dir: Path | None = None,
        liveness_period_s: float | None = 1.0,
        liveness_limit_s: float = 4.0,
        rested_s: float = 0.0,
        silent_board: bool = False,
        on_sent: Callable[[SentEvent], None] | None = None,
        on_face: Callable[[FaceEvent], None] | None = None,
        on_state: Callable[[Snapshot], None] | None = None,
    ) -> None:
        if time_scale is not None and not (math.isfinite(time_scale) and 0.01 <= time_scale <= 100):
            raise ParameterError("time_scale", time_scale, "0.01 to 100")
        if not (math.isfinite(rested_s) and rested_s >= 0.0):
            raise ParameterError("rested_s", rested_s, "0 or more")
        board = Lsc() if board is None else board
        baud = board.quirks.usual_baud if baud is None else baud
        require_fit(board, rules, baud)
        self.port = port
        self.board = board
        quantum_m = max(strut.quantum_m for strut in rules.calibration.struts)
        shapes = ShapeMemory(rules.shape_check, 0.5 * SHAPE_STEP_M + quantum_m, rules.limits.back_drive_n)
        self.rules = replace(rules, shape_check=shapes.recall, loads=shapes.loads)
        self._judging_rules = replace(rules, shape_check=shapes.judge)
        self._wanted_time_scale = time_scale
        self._liveness_period_s = liveness_period_s
        self._state_dir = state_directory() if state_dir is None else state_dir
        channels = rules.calibration.channels
        self._link = Link(SerialTransport(port, baud), board, channels, liveness_period_s, liveness_limit_s)
        self._engine = Engine(port, self.rules, board, self._link, Callbacks(on_sent, on_face, on_state))
        self._opening = threading.Lock()
        self._streamer: Streamer | None = None
        self._handshake: Handshake | None = None
        self._records: Records | None = None
        self._rested_s = rested_s
        self._silent_board = silent_board
        self._motion_count = 0

    def __enter__(self) -> Bridge:
        """Opened; see `open`."""
        self.open()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.close()

    # ---- life -------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Opens the port and starts the clock and the stream; nothing moves. `seq` and robot time begin anew.

        Raises:
            TransportError: `PortMissing`, `PortBusy` or `PortWrongKind`, with the remedy.
            BoardMismatch: the virtual prototype behind the port has another board.
            TimeScaleError: the time scale does not fit the port.
            StateError: it is open.
        """
        with self._opening:
            if self._streamer is not None:
                raise StateError("open", self._engine.state.mode, "the bridge is open; close it first")
            time_scale, records = self._connect(self._wanted_time_scale)
            with self._engine.lock:
                self._engine.begin(time_scale, records, self._rested_s)
            self._rested_s = 0.0  # said of now, not of a later opening
            period_s = self.rules.pacing.period_s / time_scale
            self._streamer = Streamer(self._engine.tick, self._engine.tick_failed, period_s)
            self._streamer.start()

    def close(self) -> None:
        """Ends any motion and closes the port; closing twice is fine. The struts keep their power and hold.

        Raises:
            StateFileError: the last pulses could not be kept; the port is closed all the same.
        """
        with self._opening:
            streamer, self._streamer = self._streamer, None
            if streamer is None:
                return
            streamer.stop()
            with self._engine.lock:
                state = self._engine.state
                if state.mode is not Mode.FAULT:
                    self._engine.apply(Disarm("" if state.lease is None else state.lease.token))
                self._link.close()
                self._engine.tell_state(force=True)
                try:
                    self._engine.save_record(durable=True)
                finally:
                    self._let_go_of_robot()

    # ---- commands ---------------------------------------------------------------------------------------------------

    def judge_homing(self, confirmed_lengths_m: Sequence[float | None] | None = None) -> None:
        """Judges the shapes on the way to mid stroke, which may take a second, and remembers the verdicts for `arm`.

        On a port just opened it also waits for the board's first answer.

        `arm` does it by itself; who must not wait there calls this first, in a thread that may.
        """
        with self._engine.lock:
            state = self._engine.state
        if state.mode is Mode.FAULT or state.lease is not None:
            return
        if not self._silent_board:
            self._link.wait_for_first_answer()
        with suppress(Refused):
            pulses_us = known_pulses(self.rules, state, _arming("", True, "", confirmed_lengths_m))
            check_homing(self._judging_rules, pulses_us, homing_path(self.rules, pulses_us))

    def judge_motion(self, trajectory: Trajectory, lease: str) -> None:
        """As `judge_homing`, for `execute` of a robot whose struts rest. Only the holder's commands are worth the work."""
        with self._engine.lock:
            state, present_m = self._engine.state, self._engine.lengths_m()
        if state.homed and state.motion is None and state.lease is not None and state.lease.token == lease:
            with suppress(Refused):
                check_trajectory(self._judging_rules, present_m, trajectory)

    def returns(self, trajectory: Trajectory) -> bool:
        """Whether a motion only takes struts nearer to mid stroke, from where they are: that way must always be open."""
        with self._engine.lock:
            path = trajectory.starting_at(self._engine.lengths_m())
        return returns(path, self.rules.calibration)

    def arm(
        self,
        holder: str,
        lifted_and_clear: bool,
        confirmed_lengths_m: Sequence[float | None] | None = None,
        prototype: str = "",
    ) -> str:
        """Takes the lease and begins homing, which ends in ARMED (see `snapshot` and `on_state`).

        Args:
            holder: who asks, for people.
            lifted_and_clear: the operator's word: robot lifted, hands clear.
            confirmed_lengths_m: None or empty: the record of the last write. Else six rest lengths in [m] as the operator sees them
                (None or NaN for a strut: its record). Where both exist they must agree within 2 mm.
            prototype: instance of the virtual prototype that is meant: no other one and no real robot is then armed. Empty:
                whatever is behind the port.

        Returns:
            the lease, to be given with every command and proven at 2 Hz or more (wall time).

        Raises:
            Refused: `WrongPrototype`, `NotClear`, `BoardSilent`, `PositionUnknown`, `LimitError`, `ShapeError`, `StateError`,
                `FaultLatched`.
            StateFileError: the last pulses cannot be kept.
        """
        self._require_prototype(prototype)
        token = secrets.token_hex(16)
        if lifted_and_clear:
            self.judge_homing(confirmed_lengths_m)
        with self._engine.lock:
            self._require_open("arm")
            self._require_prototype(prototype)  # once more: meanwhile another one may have come
            if lifted_and_clear and self._engine.state.mode is not Mode.FAULT and not self._silent_board:
                self._link.require_answered()
            self._engine.save_record()
            self._engine.apply(_arming(holder, lifted_and_clear, token, confirmed_lengths_m))
        return token

    def disarm(self, lease: str) -> None:
        """Gives the lease back and ends any motion: DISARMED, the struts hold.

        Raises:
            Refused: `LeaseError`, `FaultLatched`, `StateError`.
        """
        with self._engine.lock:
            self._require_open("disarm")
            self._engine.apply(Disarm(lease))

    def prove(self, lease: str) -> None:
        """The holder lives.

        Raises:
            Refused: `LeaseError`, `StateError`.
        """
        with self._engine.lock:
            self._require_open("prove")
            self._engine.apply(Prove(lease))

    def execute(self, trajectory: Trajectory, lease: str, stamp_age_s: float = 0.0, overtake: bool = False) -> MotionHandle:
        """Starts a motion; knots are times in robot time from now and absolute rest lengths.

        Args:
            trajectory: see `Trajectory`; `Trajectory.from_names` makes one from a message's fields.
            lease: from `arm`.
            stamp_age_s: wall time since the command was made, in [s]. What judging takes here is added.
            overtake: replace the motion that is running, without a stop between: it ends as `overtaken`. The new one begins some
                `LEAD_S` of wall time from now, from where the old one has come to then; its times are the least ones (see
                `safety.overtaking`), also if that motion has just ended.

        Raises:
            Refused: nothing moves. `LimitError`, `ShapeError`, `LeaseError`, `StaleError`, `StateError`, `FaultLatched`.
        """
        age = Age(stamp_age_s)
        lead_s = LEAD_S * self._engine.clock.time_scale
        while overtake:
            with self._engine.lock:
                state, present_m = self._engine.state, self._engine.lengths_m()
            motion = state.motion
            if motion is None or state.lease is None or state.lease.token != lease:
                break
            from_s = min(motion.progress_s + lead_s, motion.path.duration_s)
            with suppress(Refused, TrajectoryError):
                path = joined(motion, from_s, trajectory, self.rules.limits.speed_m_s)
                check_trajectory(self._judging_rules, present_m, path)
            with self._engine.lock:
                now = self._engine.state.motion
                runs = now is not None and now.number == motion.number
                if now is not None and runs and (now.progress_s <= from_s or lead_s > MOST_LEAD * LEAD_S):
                    return self._accept(trajectory, lease, age, (motion.number, from_s))
            lead_s *= 2.0  # judging took longer than that
        if overtake:
            trajectory = paced(self._engine.lengths_m(), trajectory, self.rules.limits.speed_m_s)
        self.judge_motion(trajectory, lease)
        return self._accept(trajectory, lease, age)

    def _accept(self, trajectory: Trajectory, lease: str, age: Age, overtaken: tuple[int, float] | None = None) -> MotionHandle:
        """Has the supervisor take a motion, or a motion in the place of another (its number, and where)."""
        with self._engine.lock:
            self._require_open("execute")
            number = self._motion_count + 1
            asked = Execute(trajectory, lease, age.now_s(), number)
            self._engine.apply(asked if overtaken is None else Overtake(asked, *overtaken))
            self._motion_count = number
            motion = self._engine.state.motion
            duration_s = trajectory.duration_s if motion is None else motion.path.duration_s
            return self._engine.add_motion(number, duration_s)

    def hold(self, reason: str) -> None:
        """Ends any motion with the struts held where they are; ARMED becomes HOLD, from which `execute` goes on.

        While homing, the lease is lost: half homed is not homed.
        """
        with self._engine.lock:
            self._require_open("hold")
            self._engine.apply(Hold(reason))

    def stop(self, reason: str = "stop pressed") -> None:
        """Latches FAULT with the struts held. Works in every state and never raises.

        No frame that could move a strut is begun after this call. No board can be told to stop where it is and say so,
        hence the struts are sent to where the board must be by now. This is not an emergency stop: that is a switch on the
        servo supply.
        """
        with self._engine.barred(), self._engine.lock:
            self._engine.apply(Stop(reason))

    def reset(self) -> None:
        """Leaves FAULT for DISARMED. A lost link is opened again first; robot time and `seq` go on.

        Raises:
            TransportError, TimeScaleError: the link cannot be opened, or the board does not answer any more; FAULT stays.
            StateError: the bridge is closed.
        """
        with self._opening:
            self._require_open("reset")
            if not self._link.is_up:
                _, records = self._connect(self._engine.clock.time_scale)
                was_dirty = self._link.resynchronise()
                with self._engine.lock:
                    self._engine.use_records(records)
                    if was_dirty and self.board.quirks.error_moves:
                        self._engine.forget_positions()
                    self._engine.reopened()
            with self._engine.lock:
                self._engine.apply(Reset())
                self._engine.tell_state(force=True)

    def observe_face(self, face: str, source: str, settled: bool, detail: str = "") -> FaceEvent:
        """Numbers a face observation into the stream.

        Args:
            face: `TC1`…`TC8`, `TO1`…`TO12`, or empty: on no face.
            source: one of `events.SOURCES`.
            settled: the robot had come to rest.
            detail: for people.

        Raises:
            ParameterError: no such face or source.
            StateError: the bridge is closed.
        """
        if face and face not in FACES:
            raise ParameterError("face", repr(face), "TC1 to TC8, TO1 to TO12, or empty")
        if source not in SOURCES:
            raise ParameterError("source", repr(source), ", ".join(SOURCES))
        with self._engine.lock:
            self._require_open("observe_face")
            return self._engine.emit_face(face, source, settled, printable(detail))

    def snapshot(self) -> Snapshot:
        """The bridge now, in any state."""
        return self._engine.snapshot()

    @property
    def observer(self) -> str | None:
        """Path of the virtual prototype's observer socket; None on a real port."""
        return None if self._handshake is None else self._handshake.observer

    @property
    def board_timeout_s(self) -> float | None:
        """Serial time-out in [s] of the board to set on one that has it: the bridge's queries are more frequent than that.

        None: the board has none, or the bridge is told to ask nothing.
        """
        if not self.board.quirks.has_timeout or self._liveness_period_s is None:
            return None
        return timeout_s(self._liveness_period_s * self._engine.clock.time_scale)

    # ---- shared -----------------------------------------------------------------------------------------------------

    def _connect(self, wanted_time_scale: float | None) -> tuple[float, Records]:
        """Opens the port, real or virtual, and finds the records of the robot behind it."""
        handshake, doubt = examine(self.port)
        if doubt:
            _log.warning("%s is taken for a real port, not for a virtual prototype's: %s", self.port, doubt)
        agree_on_board(self.port, self.board.spec, handshake)
        time_scale = agree_on_time_scale(self.port, wanted_time_scale, handshake)
        identity = identity_of(self.port, self.rules.calibration, self.board, handshake)
        records = self._records
        if records is None or records.identity != identity or not identity.is_known:
            self._let_go_of_robot()
            records = Records(self._state_dir, identity, self.rules.limits, self.port)
        try:
            self._link.open()
            if handshake is not None:
                require_same_pty(self.port, handshake, self._link.transport.descriptor)
        except BaseException:
            self._link.close()
            if records is not self._records:
                records.close()
            raise
        self._handshake, self._records = handshake, records
        self._engine.prototype = "" if handshake is None else handshake.instance
        return time_scale, records

    def _let_go_of_robot(self) -> None:
        records, self._records = self._records, None
        if records is not None:
            records.close()

    def _require_prototype(self, wanted: str) -> None:
        if wanted and wanted != self._engine.prototype:
            raise WrongPrototype(wanted, self.port, self._engine.prototype)

    def _require_open(self, command: str) -> None:
        if self._streamer is None:
            raise StateError(command, self._engine.state.mode, "the bridge is closed; open it first")


def _arming(holder: str, clear: bool, token: str, confirmed_m: Sequence[float | None] | None) -> Arm:
    given = () if confirmed_m is None else tuple(confirmed_m)
    return Arm(printable(holder, NAME_MOST) or "somebody", clear, token, given or NONE_KNOWN)
