# SPDX-License-Identifier: Apache-2.0
"""Boards as exact straight lines, driven by the real engine on a clock that the test sets.

Written anew, with nothing of the virtual prototype or of the bridge's own account of its board: what a servo is told at every
instant, from the bytes alone.
"""

from dataclasses import dataclass, field

import numpy as np

from hardware_bridge.boards import lsc, maestro, ssc32
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.driver.engine import Engine
from hardware_bridge.driver.events import Callbacks, SentEvent
from hardware_bridge.driver.motion_handle import MotionHandle
from hardware_bridge.errors import Refused
from hardware_bridge.link.board_link import Link
from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.supervisor_messages import Arm, Execute, Hold, Mode, Now, Prove, Stop
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID


@dataclass
class Servo:
    """What one channel is told: corners (time in s, pulse in us), the last of which may lie in the future."""

    corners: list[tuple[float, float]] = field(default_factory=list)
    target_us: float | None = None
    units: int = 0

    def at(self, time_s: float) -> float:
        times, pulses = zip(*self.corners, strict=True)
        return float(np.interp(time_s, times, pulses))

    def turn(self, time_s: float, pulse_us: float, end_s: float) -> None:
        """From where it is at `time_s`, whatever was said before, straight to a pulse."""
        if not self.corners:
            self.corners = [(time_s, pulse_us)]  # the first order jumps
        here = self.at(time_s)
        self.corners = [corner for corner in self.corners if corner[0] < time_s] + [(time_s, here)]
        if end_s > time_s:
            self.corners.append((end_s, pulse_us))
        self.target_us = pulse_us


class Lines:
    """The far end of the line: bytes arrive at the baud rate (0: at once), and each command acts with its last byte."""

    def __init__(self, spec: str, baud: int = 0) -> None:
        self.spec = spec
        self.port = "lines"
        self.servos: dict[int, Servo] = {}
        self.durations_ms: list[int] = []
        self.now_s = 0.0
        self._byte_s = 10.0 / baud if baud else 0.0
        self._free_s = 0.0
        self._lsc, self._ssc32, self._packet = lsc.FrameDecoder(), ssc32.LineDecoder(), bytearray()
        self.broken = False

    def open(self) -> None:
        """See `SerialTransport`."""

    def close(self) -> None:
        """See `SerialTransport`."""

    def read_available(self) -> bytes:
        """It never answers."""
        return b""

    def pending_bytes(self) -> int:
        """What the line has still to carry."""
        return int(np.ceil((self._free_s - self.now_s) / self._byte_s - 1e-6)) if self._free_s > self.now_s else 0

    def write_all(self, data: bytes) -> None:
        """Bytes of a frame, handed over now."""
        for byte in data:
            self._free_s = max(self._free_s, self.now_s) + self._byte_s
            self._take(byte, self._free_s)

    def _take(self, byte: int, time_s: float) -> None:
        one = bytes((byte,))
        if self.spec == "lsc":
            for frame in self._lsc.feed(one):
                move = lsc.decode_move(frame)
                if move is not None:
                    self._timed(dict(zip(move.channels, move.pulses_us, strict=True)), move.duration_ms, time_s)
        elif self.spec == "ssc32":
            for command in self._ssc32.feed(one):
                if isinstance(command, ssc32.Group):
                    assert command.duration_ms is not None
                    self._timed({t.channel: t.pulse_us or 0 for t in command.targets}, command.duration_ms, time_s)
        else:
            self._packet += one
            if len(self._packet) == 4:
                command, channel, low, high = self._packet
                self._packet.clear()
                self._paced(command, channel, low | high << 7, time_s)

    def _timed(self, pulses_us: dict[int, int], duration_ms: int, time_s: float) -> None:
        self.durations_ms.append(duration_ms)
        for channel, pulse_us in pulses_us.items():
            self.servos.setdefault(channel, Servo()).turn(time_s, pulse_us, time_s + duration_ms * 1e-3)

    def _paced(self, command: int, channel: int, value: int, time_s: float) -> None:
        servo = self.servos.setdefault(channel, Servo())
        if command == maestro.SET_SPEED:
            assert value > 0, "0 is full speed"
            servo.units = value
        else:
            assert command == maestro.SET_TARGET
            servo.target_us = value / 4
        if servo.target_us is not None:
            way_us = abs(servo.target_us - servo.at(time_s)) if servo.corners else 0.0
            servo.turn(time_s, servo.target_us, time_s + (way_us / (servo.units * 25.0) if servo.units else 0.0))


class KeptPulses:
    """The record of the last pulses, in memory."""

    why = ""

    def __init__(self) -> None:
        self.pulses_us: tuple[int | None, ...] = (None,) * 6

    def load(self, channels: object) -> tuple[int | None, ...]:
        return self.pulses_us

    def save(self, channels: object, pulses_us: tuple[int | None, ...], force: bool = False, durable: bool = False) -> None:
        self.pulses_us = tuple(pulses_us)

    def forget(self, channels: object) -> None:
        self.pulses_us = (None,) * 6


class KeptDuty:
    """The record of running, which forgets."""

    def load(self, now_s: float, time_scale: float, rested_s: float = 0.0) -> Duty:
        return Duty()

    def save(self, *words: object, **options: object) -> None:
        pass

    try_to_save = save


class Kept:
    """What is remembered of the robot, in memory: these tests write ten thousands of frames."""

    def __init__(self) -> None:
        self.pulses, self.duty = KeptPulses(), KeptDuty()


class SetClock:
    """The robot's clock, as the test sets it."""

    def __init__(self, lines: Lines) -> None:
        self.lines, self.time_scale = lines, 1.0

    def now(self) -> Now:
        return Now(self.lines.now_s, self.lines.now_s)

    def now_ns(self) -> int:
        return int(self.lines.now_s * 1e9)


class Rig:
    """The real engine, supervisor, gate, link and codec on `Lines`; time passes when the test says so."""

    def __init__(self, spec: str, rules: Rules, baud: int = 0) -> None:
        self.rules = rules
        self.lines = lines = Lines(spec, baud)
        self.sent: list[SentEvent] = []
        board = parse_board(spec)
        self.link = Link(lines, board, rules.calibration.channels, None, 4.0)  # type: ignore[arg-type]
        self.engine = Engine("lines", rules, board, self.link, Callbacks(on_sent=self.sent.append))
        self.link.open()
        self.kept = Kept()
        self.engine.begin(1.0, self.kept)  # type: ignore[arg-type]
        self.engine.clock = SetClock(lines)  # type: ignore[assignment]
        self.motions = 0

    def tick(self, after_s: float) -> None:
        """The frame loop comes, `after_s` later."""
        self.lines.now_s += after_s
        lease = self.engine.state.lease
        if lease is not None:
            self.engine.apply(Prove(lease.token))
        self.engine.tick(0)

    def arm(self, lengths_m: tuple[float | None, ...] = MID) -> None:
        """Until ARMED."""
        self.engine.apply(Arm("test", True, "key", lengths_m))
        while self.engine.state.mode is Mode.HOMING:
            self.tick(self.rules.pacing.period_s)

    def execute(self, trajectory: Trajectory) -> MotionHandle:
        """Raises Refused."""
        self.motions += 1
        self.engine.apply(Execute(trajectory, "key", 0.0, self.motions))
        return self.engine.add_motion(self.motions, trajectory.duration_s)

    def accepts(self, trajectory: Trajectory) -> bool:
        """As execute; whether it was accepted."""
        try:
            self.execute(trajectory)
        except Refused:
            return False
        return True

    def stop(self, after_s: float = 0.0) -> np.ndarray:
        """Stop; where the board was when the hold was handed over, (6,) in us."""
        self.lines.now_s += after_s
        self.engine.apply(Stop())
        return self.at_us(self.lines.now_s)

    def hold(self, after_s: float = 0.0) -> np.ndarray:
        """Cancel; where the board was when the hold was handed over, (6,) in us."""
        self.lines.now_s += after_s
        self.engine.apply(Hold("cancelled"))
        return self.at_us(self.lines.now_s)

    # ---- what is seen -----------------------------------------------------------------------------------------------

    def at_us(self, time_s: float) -> np.ndarray:
        """What the servos are told at a time, (6,)."""
        return np.array([self.lines.servos[channel].at(time_s) for channel in self.rules.calibration.channels])

    def run_on_us(self, since_s: float) -> float:
        """How far any servo still goes from where it was at a time; in us, over one frame of the limit."""
        return float(self.run_on(since_s).max())

    def run_on(self, since_s: float) -> np.ndarray:
        """How far each servo is ever told to go from where it was at a time, (6,) in us."""
        return np.array([self._run_on(self.lines.servos[channel], since_s) for channel in self.rules.calibration.channels])

    @staticmethod
    def _run_on(servo: Servo, since_s: float) -> float:
        here = servo.at(since_s)
        return max((abs(pulse - here) for time_s, pulse in servo.corners if time_s >= since_s), default=0.0)

    def speeds_us_s(self) -> np.ndarray:
        """The highest speed that each servo was ever told, (6,)."""
        return np.array([self._speed(self.lines.servos[channel]) for channel in self.rules.calibration.channels])

    @staticmethod
    def _speed(servo: Servo) -> float:
        corners = np.array(servo.corners)
        times, ways = np.diff(corners[:, 0]), np.abs(np.diff(corners[:, 1]))
        assert (ways[times < 1e-9] < 1e-6).all(), "a jump"
        moving = times >= 1e-9
        return float((ways[moving] / times[moving]).max(initial=0.0))

    def most_ahead_us(self, speed_us_s: np.ndarray) -> np.ndarray:
        """By how much each servo was ever told to be ahead of a speed, over whatever span of time, (6,)."""
        ahead = []
        for channel, speed in zip(self.rules.calibration.channels, speed_us_s, strict=True):
            corners = np.array(self.lines.servos[channel].corners)
            leads = [sign * corners[:, 1] - speed * corners[:, 0] for sign in (1, -1)]
            ahead.append(max(float((lead - np.minimum.accumulate(lead)).max()) for lead in leads))
        return np.array(ahead)
