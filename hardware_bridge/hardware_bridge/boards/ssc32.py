# SPDX-License-Identifier: Apache-2.0
"""Lynxmotion SSC-32 and SSC-32U: lines of ASCII, ended by CR; no checksum, no acknowledgement.

Source: Lynxmotion, "SSC-32U USB servo controller board user guide", pp. 24-26, 33-34 and 38-39; the cancel (`ESC CR`)
is from the source of the ROS driver `lynxmotion_ssc32u`. 9600 baud as delivered, 38400 and 115200 by its button: a move
of six servos takes 48 bytes, 50 ms at 9600 baud, so 115200 is what this bridge expects.

Not documented by the maker, and so assumed: a line that is no command is ignored whole, and a channel that has had no
move since power-up answers `QP` with 0. If a real board answers otherwise, its reset goes unnoticed and nothing worse.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hardware_bridge.boards.board import Board, Health, Query, Quirks, check_channels

CANCEL = b"\x1b\r"
PULSE_STEP_US = 10
"""`QP` answers in steps of this."""
MAX_LINE = 512
"""Bytes of a line kept while its end has not come; a longer one is no command."""

QUIRKS = Quirks(
    pulse_us=(500, 2500),
    channels=(0, 31),
    duration_ms=(20, 65535),
    longest_frame_bytes=55,
    usual_baud=115200,
    cancel=CANCEL,
    resync_queries=3,
    error_moves=False,
    tells_pulses=True,
    has_timeout=False,
    always_answers=True,
)

_OFFSET_US = (-100, 100)


@dataclass(frozen=True)
class Target:
    """One channel of a move: pulse in [us]; None: the pulse off. `speed_us_s` in [us/s], None: as fast as it can."""

    channel: int
    pulse_us: int | None
    speed_us_s: int | None = None


@dataclass(frozen=True)
class Group:
    """A move of channels that start and, with `duration_ms`, stop together."""

    targets: tuple[Target, ...]
    duration_ms: int | None = None


@dataclass(frozen=True)
class Offset:
    """`PO`: shifts a channel's pulse by -100 to 100 us."""

    channel: int
    offset_us: int


@dataclass(frozen=True)
class Stop:
    """Stops one channel at once, wherever it is."""

    channel: int


@dataclass(frozen=True)
class AskMoving:
    """`Q`: is a move under way?"""


@dataclass(frozen=True)
class AskPulses:
    """`QP`: the commanded pulses of channels, one byte each."""

    channels: tuple[int, ...]


Command = Group | Offset | Stop | AskMoving | AskPulses
"""What the virtual prototype obeys; it answers neither analogue inputs nor `VER`, which the SSC-32U has not."""


def encode_pulse_reply(pulses_us: Sequence[float | None]) -> bytes:
    """What the board answers to `QP`."""
    return bytes(0 if pulse is None else min(255, round(pulse / PULSE_STEP_US)) for pulse in pulses_us)


_GROUP = re.compile(r"(?:#\d{1,2}(?:P\d{1,5}(?:S\d{1,5})?|L))+(?:T\d{1,5})?")
_TARGET = re.compile(r"#(\d{1,2})(?:P(\d{1,5})(?:S(\d{1,5}))?|(L))")
_OFFSET = re.compile(r"#(\d{1,2})PO(-?\d{1,3})")
_STOP = re.compile(r"STOP(\d{1,2})")
_PULSES = re.compile(r"(?:QP\d{1,2})+")


def decode_line(line: bytes) -> Command | None:
    """The command in a line without its CR, or None if it is none. Case, spaces, tabs and line feeds do not matter."""
    text = re.sub(r"[ \t\n]", "", line.decode("ascii", errors="replace").upper())
    if _GROUP.fullmatch(text):
        return _decode_group(text)
    if match := _OFFSET.fullmatch(text):
        channel, offset = int(match[1]), int(match[2])
        return Offset(channel, offset) if _on_board(channel) and _OFFSET_US[0] <= offset <= _OFFSET_US[1] else None
    if match := _STOP.fullmatch(text):
        return Stop(int(match[1])) if _on_board(int(match[1])) else None
    if _PULSES.fullmatch(text):
        channels = tuple(int(number) for number in text.split("QP")[1:])
        return AskPulses(channels) if all(map(_on_board, channels)) else None
    return AskMoving() if text == "Q" else None


def _decode_group(text: str) -> Group | None:
    targets = []
    for match in _TARGET.finditer(text):
        channel, pulse = int(match[1]), None if match[4] or match[2] == "0" else int(match[2])
        if not _on_board(channel) or (pulse is not None and not QUIRKS.pulse_us[0] <= pulse <= QUIRKS.pulse_us[1]):
            return None
        targets.append(Target(channel, pulse, int(match[3]) if match[3] else None))
    duration = int(text.rsplit("T", 1)[1]) if "T" in text else None
    return None if duration is not None and duration > QUIRKS.duration_ms[1] else Group(tuple(targets), duration)


def _on_board(channel: int) -> bool:
    return QUIRKS.channels[0] <= channel <= QUIRKS.channels[1]


@dataclass
class LineDecoder:
    """Finds commands in a stream that arrives in pieces of any size. Survives any bytes.

    A line goes on until its CR, so a cut one takes the next as its rest; ESC forgets what has come of a line.
    """

    _line: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> list[Command]:
        """Commands that `data` completes, in order."""
        commands: list[Command] = []
        for byte in data:
            if byte == CANCEL[0]:
                self._line.clear()
            elif byte == CANCEL[1]:
                command = decode_line(bytes(self._line)) if len(self._line) <= MAX_LINE else None
                self._line.clear()
                commands += [] if command is None else [command]
            elif len(self._line) <= MAX_LINE:
                self._line.append(byte)
        return commands


@dataclass(frozen=True)
class Ssc32(Board):
    """The SSC-32 family as a `Board`."""

    name = "ssc32"
    quirks = QUIRKS

    def frame(self, pulses_us: Mapping[int, int], duration_ms: int, from_us: Sequence[float]) -> bytes:
        """See `Board`."""
        body = "".join(f"#{channel}P{pulse}" for channel, pulse in pulses_us.items())
        return f"{body}T{duration_ms}\r".encode("ascii")

    def encode_query(self, channels: Sequence[int]) -> Query:
        """`QP` of every channel: `VER` is not on every board, and this one also shows a reset."""
        check_channels(channels, self.quirks)
        return Query("".join(f"QP{channel}" for channel in channels).encode("ascii") + b"\r", len(channels))

    def parse_reply(self, reply: bytes, count: int) -> Health | None:
        """Commanded pulses, to 10 us; None for a wrong number of bytes or a pulse that no board gives."""
        low, high = (limit // PULSE_STEP_US for limit in self.quirks.pulse_us)
        if len(reply) != count or any(byte and not low <= byte <= high for byte in reply):
            return None
        return Health(pulses_us=tuple(float(byte * PULSE_STEP_US) if byte else None for byte in reply))
