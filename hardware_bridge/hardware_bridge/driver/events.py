# SPDX-License-Identifier: Apache-2.0
"""What the bridge tells its callers: the numbered stream of what happened to the robot, and its own state."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

from hardware_bridge.link.latency import Percentiles, Replies
from hardware_bridge.safety.supervisor_messages import Mode

_log = logging.getLogger(__name__)

FACES = (*(f"TC{number}" for number in range(1, 9)), *(f"TO{number}" for number in range(1, 13)))
SOURCES = ("operator", "prototype", "external", "imu")
"""Who may observe a face. A *predicted* face is no observation and is not part of the stream."""


@dataclass(frozen=True)
class SentEvent:
    """One write to the board, or a heartbeat: nothing written, the clock has moved on.

    Attributes:
        seq: place in the stream, from 1, shared with `FaceEvent`.
        robot_time_ns: robot time of the write, in [ns]; never less than that of an earlier `seq`.
        heartbeat: nothing was written; the lengths are those last sent.
        lengths_m: rest lengths of S1 to S6 as whole pulses, in [m]; mid stroke where `known` is false.
        known: whether each strut's length was ever sent or confirmed.
        pulses_us: pulses of S1 to S6, in [us]; 0 where not known.
        duration_ms: duration asked of the board; 0 for a heartbeat.
        frame: the bytes on the wire; empty for a heartbeat.
        kind: `energise`, `home`, `move`, `hold` or `heartbeat`.
        session: the opening of the port that the event belongs to; nothing of another one is about this robot now.
        wall_ns: the computer's clock at the event, in [ns] since 1970.
    """

    seq: int
    robot_time_ns: int
    heartbeat: bool
    lengths_m: tuple[float, ...]
    known: tuple[bool, ...]
    pulses_us: tuple[int, ...]
    duration_ms: int
    frame: bytes
    kind: str
    session: str = ""
    wall_ns: int = 0


@dataclass(frozen=True)
class FaceEvent:
    """Somebody saw which face the robot stands on.

    Attributes:
        seq: place in the stream, from 1, shared with `SentEvent`.
        robot_time_ns: robot time at which the bridge was told, in [ns].
        face: `TC1`…`TC8`, `TO1`…`TO12`, or empty: on no face.
        source: one of `SOURCES`.
        settled: the robot had come to rest.
        detail: for people.
        session, wall_ns: as `SentEvent`.
    """

    seq: int
    robot_time_ns: int
    face: str
    source: str
    settled: bool
    detail: str
    session: str = ""
    wall_ns: int = 0


@dataclass(frozen=True)
class Snapshot:
    """The bridge at one instant.

    Attributes:
        robot_time_ns: robot time, in [ns].
        last_seq: number of the newest event of the stream; 0 before the first.
        mode: the supervisor's state.
        reason: why, for people; may be empty.
        lease_holder: who armed; empty if nobody.
        homed: homing has ended well since the last arm.
        moving: a commanded motion is running.
        port: path or URL.
        link_ok: the port is open and the last read and write went through.
        virtual_port: the port is the virtual prototype's.
        time_scale: robot seconds per second.
        lengths_m: as `SentEvent`.
        known: as `SentEvent`.
        energised: which struts have been sent a pulse since the port was opened.
        calibration_hash: of the calibration in use.
        robot: the robot's name, by its calibration; empty: it names none.
        answered: the board has answered since the port was opened.
        battery_mv: last reply of the board, in [mV]; None before the first.
        duty_left_s: how long the strut that has least left may still run without a pause, over both windows, in robot time, in [s].
        duty_known: somebody knows how long the struts ran lately; else it counts as spent.
        duty_limit_s: what a strut that has rested may run, in [s].
        supply_low_v: servo supply below which no gait is begun, in [V].
        write_latency: how long the port took to take each frame, the last 1200.
        reopened: how often a lost link was opened again since `open`.
        board_errors: what the board said is wrong with it, until reset; empty also for a board that cannot say.
        replies: how the board answers its liveness queries, since `open`.
        prototype: the virtual prototype's instance, if the port has proven to be one's; empty on a real port.
        frames_sent: frames written since `open`.
        write_errors: failed or partial writes since `open`.
        late_periods: periods that the frame loop missed, dropped and not made up for.
        congested_periods: periods without a frame because the port still held the one before, or an answer was late.
        session: as `SentEvent`; empty before the first opening.
    """

    robot_time_ns: int
    last_seq: int
    mode: Mode
    reason: str
    lease_holder: str
    homed: bool
    moving: bool
    port: str
    link_ok: bool
    virtual_port: bool
    time_scale: float
    lengths_m: tuple[float, ...]
    known: tuple[bool, ...]
    energised: tuple[bool, ...]
    calibration_hash: str
    battery_mv: int | None
    duty_left_s: float
    frames_sent: int
    write_errors: int
    late_periods: int
    congested_periods: int
    duty_limit_s: float
    supply_low_v: float
    write_latency: Percentiles
    reopened: int
    board_errors: tuple[str, ...]
    replies: Replies
    session: str
    robot: str
    answered: bool
    duty_known: bool
    prototype: str


@dataclass(frozen=True)
class Callbacks:
    """Whom to tell. Called under the lock: short, and never back into the bridge. An exception in one is logged."""

    on_sent: Callable[[SentEvent], None] | None = None
    on_face: Callable[[FaceEvent], None] | None = None
    on_state: Callable[[Snapshot], None] | None = None

    def tell(self, event: SentEvent | FaceEvent | Snapshot) -> None:
        """Calls whoever wants to know of it."""
        try:
            match event:
                case SentEvent() if self.on_sent is not None:
                    self.on_sent(event)
                case FaceEvent() if self.on_face is not None:
                    self.on_face(event)
                case Snapshot() if self.on_state is not None:
                    self.on_state(event)
        except Exception:
            _log.exception("callback of the bridge")
