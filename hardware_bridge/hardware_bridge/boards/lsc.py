# SPDX-License-Identifier: Apache-2.0
"""Hiwonder / LewanSoul LSC-6, -16, -24: `55 55 Len Cmd prm...`, Len = number of parameters + 2, little-endian.

9600 baud, 8N1, no checksum, no acknowledgement. Source: Hiwonder, "controller communication protocol" V1.2.

Not documented by the maker, and so assumed: there is no inter-byte timeout and no cancel, so after a cut frame the
board takes the beginning of the next one as the cut one's rest. `0x07` stops action groups only; a servo is stopped
by sending its last pulse again. A reset cannot be noticed: the board tells its supply voltage and nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hardware_bridge.boards.board import Board, Health, Query, Quirks, check_range

HEADER = b"\x55\x55"
CMD_MOVE = 0x03
CMD_BATTERY = 0x0F
CMD_UNLOAD = 0x14

MAX_LENGTH = 3 * 32 + 5
"""The largest Len that any board of the family sends or takes: a move of 32 servos."""

QUIRKS = Quirks(
    pulse_us=(500, 2500),
    channels=(1, 32),
    duration_ms=(20, 30000),
    longest_frame_bytes=25,
    usual_baud=9600,
    cancel=b"",
    resync_queries=26,  # they fill the longest frame that a stray byte can announce (0x65 + 2 bytes)
    error_moves=False,
    tells_pulses=False,
    has_timeout=False,
    always_answers=False,
)


@dataclass(frozen=True)
class Frame:
    """One frame in either direction: command and parameter bytes."""

    command: int
    parameters: bytes


@dataclass(frozen=True)
class Move:
    """A decoded move: `channels[i]` to `pulses_us[i]` [us] within `duration_ms`."""

    channels: tuple[int, ...]
    pulses_us: tuple[int, ...]
    duration_ms: int


def encode_frame(command: int, parameters: bytes = b"") -> bytes:
    """Bytes of one frame."""
    return HEADER + bytes((len(parameters) + 2, command)) + parameters


def decode_move(frame: Frame) -> Move | None:
    """The move in a frame, or None if it is another command or no move that the board would accept."""
    prm = frame.parameters
    if frame.command != CMD_MOVE or len(prm) < 3 or len(prm) != 3 + 3 * prm[0] or prm[0] == 0:
        return None
    channels = tuple(prm[3::3])
    pulses_us = tuple(low | high << 8 for low, high in zip(prm[4::3], prm[5::3], strict=True))
    if not all(QUIRKS.channels[0] <= channel <= QUIRKS.channels[1] for channel in channels):
        return None
    if not all(QUIRKS.pulse_us[0] <= pulse_us <= QUIRKS.pulse_us[1] for pulse_us in pulses_us):
        return None
    return Move(channels, pulses_us, prm[1] | prm[2] << 8)


def decode_unload(frame: Frame) -> tuple[int, ...] | None:
    """The channels to let go, or None if the frame is no valid unload."""
    prm = frame.parameters
    if frame.command != CMD_UNLOAD or not prm or len(prm) != 1 + prm[0]:
        return None
    return tuple(prm[1:])


def encode_battery_reply(millivolts: int) -> bytes:
    """What the board answers to a battery query."""
    check_range("millivolts", millivolts, (0, 0xFFFF))
    return encode_frame(CMD_BATTERY, bytes(_u16(millivolts)))


def decode_battery_reply(frame: Frame) -> int | None:
    """Supply voltage in [mV], or None if the frame is no battery reply."""
    if frame.command != CMD_BATTERY or len(frame.parameters) != 2:
        return None
    return frame.parameters[0] | frame.parameters[1] << 8


class FrameDecoder:
    """Finds frames in a stream that arrives in pieces of any size. Survives any bytes.

    It does what the board is assumed to do: without a timeout, a cut frame swallows the beginning of the next.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that `data` completes, in order."""
        self._buffer += data
        frames = []
        while (frame := self._take()) is not None:
            frames.append(frame)
        return frames

    def _take(self) -> Frame | None:
        buffer = self._buffer
        while len(buffer) >= 3:
            # No command is 0x55 long: of three such bytes the first is the stray one.
            if buffer[:2] == HEADER and 2 <= buffer[2] <= MAX_LENGTH and buffer[2] != HEADER[0]:
                size = buffer[2] + 2
                if len(buffer) < size:
                    return None
                frame = Frame(buffer[3], bytes(buffer[4:size]))
                del buffer[:size]
                return frame
            del buffer[0]
        return None


@dataclass(frozen=True)
class Lsc(Board):
    """The LSC family as a `Board`."""

    name = "lsc"
    quirks = QUIRKS

    def frame(self, pulses_us: Mapping[int, int], duration_ms: int, from_us: Sequence[float]) -> bytes:
        """See `Board`."""
        body = bytearray((len(pulses_us), *_u16(duration_ms)))
        for channel, pulse_us in pulses_us.items():
            body += bytes((channel, *_u16(pulse_us)))
        return encode_frame(CMD_MOVE, bytes(body))

    def encode_query(self, channels: Sequence[int]) -> Query:
        """The supply voltage: the board's only answer, and so the proof that it lives."""
        return Query(encode_frame(CMD_BATTERY), len(encode_battery_reply(0)))

    def parse_reply(self, reply: bytes, count: int) -> Health | None:
        """The newest voltage among whatever else the board sent: it also announces the ends of action groups."""
        voltages = [mv for frame in FrameDecoder().feed(reply) if (mv := decode_battery_reply(frame)) is not None]
        return Health(battery_mv=voltages[-1]) if voltages else None


def _u16(value: int) -> tuple[int, int]:
    return value & 0xFF, value >> 8
