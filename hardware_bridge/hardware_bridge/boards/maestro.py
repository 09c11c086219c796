# SPDX-License-Identifier: Apache-2.0
"""Pololu Maestro: binary commands, compact or Pololu protocol, with or without CRC-7; no acknowledgement.

Source: Pololu, "Maestro servo controller user's guide" (0J40), 4.e and 5.a to 5.e. Targets are in quarter microseconds,
low seven bits first; the top bit marks the first byte of a command, so a stream finds its frames by itself.

The Maestro knows speeds, not durations: a move sets, for each channel, the speed that gets it there in time, rounded down to
25 us/s, so that no limit is passed, and never a speed of 0, which would be full speed. A channel may so come late; whoever sends
the next move knows by how much (`move_time_s`). A channel that need not move gets the slowest speed, so that it creeps if it is
not where it is believed to be.

What only Pololu's Control Center can set, and must:

* serial mode "UART, fixed baud rate" (to detect the rate the board needs an 0xAA first, which only the Pololu protocol
  sends), with the rate, CRC and device number of the parameters `baud` and `board`; "never sleep";
* for the six channels: limits no narrower than the calibration's pulses, speed and acceleration 0, and *home* on
  "Ignore", because any error, even one cut frame, sends channels home ("Off" lets them go, "Go to" moves them);
* the serial time-out of `timeout_s`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hardware_bridge.boards.board import Board, Health, Query, Quirks, check_channels, check_pulses, check_range

POLOLU = 0xAA
MINI_SSC = 0xFF
SET_TARGET = 0x84
SET_SPEED = 0x87
SET_ACCELERATION = 0x89
GET_POSITION = 0x90
GET_MOVING = 0x93
SET_MULTIPLE = 0x9F
GET_ERRORS = 0xA1
GO_HOME = 0xA2
STOP_SCRIPT = 0xA4

PER_US = 4
"""Targets are in this part of a microsecond."""
SPEED_UNIT_US_S = 25.0
"""One unit of speed: a quarter microsecond every 10 ms."""
LIMITS_US = (992, 2000)
"""A channel's limits as delivered, in [us]."""
WIDEST_US = (500, 2500)
"""The widest limits that this bridge takes, in [us]."""
ERRORS = (
    "serial signal",
    "serial overrun",
    "serial buffer full",
    "serial CRC",
    "serial protocol",
    "serial time-out",
    "script stack",
    "script call stack",
    "script program counter",
)
"""Names of the bits of the error register, lowest first."""
TIMEOUT_S = (0.01, 655.35)

CHANNELS = 24
"""Of the largest; the smaller ones have 6, 12 or 18."""

_U14 = (0, 0x3FFF)
_SILENT_PERIODS = 4


def crc7(data: bytes) -> int:
    """The CRC-7 (polynomial 0x91, lowest bit first) that is appended to a packet (5.d)."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc ^ 0x91) >> 1 if crc & 1 else crc >> 1
    return crc


def timeout_s(liveness_period_s: float) -> float:
    """The serial time-out in [s of the board] to set in the Control Center for a query every `liveness_period_s`.

    Four lost queries long, so that the board and the bridge notice a dead link at about the same time.
    """
    low, high = TIMEOUT_S
    return min(max(round(_SILENT_PERIODS * liveness_period_s, 2), low), high)


def decode_errors(word: int) -> tuple[str, ...]:
    """Names of the errors in the register."""
    return tuple(name for bit, name in enumerate(ERRORS) if word >> bit & 1)


def speed_units(distance_us: float, duration_ms: int) -> int:
    """The highest speed, in units of 25 us/s and at least 1, that is no faster than needed to cover a distance in time."""
    return min(max(1, math.floor(abs(distance_us) / (duration_ms * 1e-3) / SPEED_UNIT_US_S + 1e-9)), _U14[1])


@dataclass(frozen=True)
class Maestro(Board):
    """The Maestro family as a `Board`.

    Attributes:
        device: device number of the Pololu protocol; None: the compact protocol.
        crc: whether a CRC-7 is appended to every packet.
        limits_us: the channels' limits as set in the Control Center, in [us]; the board clips silently what is beyond.
    """

    device: int | None = None
    crc: bool = False
    limits_us: tuple[int, int] = LIMITS_US

    name = "maestro"

    def __post_init__(self) -> None:
        if self.device is not None:
            check_range("device", self.device, (0, 127))
        low, high = self.limits_us
        check_range("lower limit_us", low, (WIDEST_US[0], high - 1))
        check_range("upper limit_us", high, (low + 1, WIDEST_US[1]))

    @property
    def spec(self) -> str:
        """The board with its variant, as the parameter `board` names it."""
        device = "" if self.device is None else f":device={self.device}"
        limits = "" if self.limits_us == LIMITS_US else f":limits={self.limits_us[0]}-{self.limits_us[1]}"
        return self.name + device + (":crc" if self.crc else "") + limits

    @property
    def quirks(self) -> Quirks:
        """What the bytes do not say."""
        return Quirks(
            pulse_us=self.limits_us,
            channels=(0, CHANNELS - 1),
            duration_ms=(20, 30000),
            longest_frame_bytes=12 * len(self.packet(SET_TARGET, 0, 0, 0)),
            usual_baud=115200,
            cancel=b"",
            resync_queries=3,
            error_moves=True,
            tells_pulses=True,
            has_timeout=True,
            always_answers=True,
        )

    def packet(self, command: int, *data: int) -> bytes:
        """One command in this variant of the protocol."""
        head = (command,) if self.device is None else (POLOLU, self.device, command & 0x7F)
        packet = bytes((*head, *data))
        return packet + bytes((crc7(packet),)) if self.crc else packet

    def set_target(self, channel: int, pulse_us: float) -> bytes:
        """A target in [us]; 0 takes the pulse off. Raises CodecError."""
        return self._set(SET_TARGET, channel, "quarter microseconds", round(pulse_us * PER_US))

    def set_speed(self, channel: int, units: int) -> bytes:
        """A speed in units of 25 us/s; 0 is full speed. Raises CodecError."""
        return self._set(SET_SPEED, channel, "speed", units)

    def ask_position(self, channel: int) -> bytes:
        """Answered by the commanded pulse, two bytes. Raises CodecError."""
        check_channels([channel], self.quirks)
        return self.packet(GET_POSITION, channel)

    def frame(self, pulses_us: Mapping[int, int], duration_ms: int, from_us: Sequence[float]) -> bytes:
        """Speeds, then targets."""
        units = [speed_units(to - at, duration_ms) for to, at in zip(pulses_us.values(), from_us, strict=True)]
        speeds = b"".join(self.set_speed(channel, unit) for channel, unit in zip(pulses_us, units, strict=True))
        return speeds + self.encode_hold(list(pulses_us.values()), list(pulses_us), duration_ms)

    def encode_hold(self, pulses_us: Sequence[int], channels: Sequence[int], duration_ms: int) -> bytes:
        """Targets only: they are gone to at the speed of the last move. Raises CodecError."""
        check_pulses(pulses_us, channels, self.quirks)
        return b"".join(self.set_target(channel, pulse_us) for channel, pulse_us in zip(channels, pulses_us, strict=True))

    def move_time_s(self, way_us: float, duration_ms: int) -> float:
        """At the speed that `encode_move` sets."""
        return abs(way_us) / (speed_units(way_us, duration_ms) * SPEED_UNIT_US_S)

    def encode_query(self, channels: Sequence[int]) -> Query:
        """Errors, which this clears, and the commanded pulse of every channel."""
        positions = b"".join(self.ask_position(channel) for channel in channels)
        return Query(self.packet(GET_ERRORS) + positions, 2 + 2 * len(channels))

    def parse_reply(self, reply: bytes, count: int) -> Health | None:
        """Errors and commanded pulses; None for a wrong number of bytes or values that no Maestro gives."""
        if len(reply) != 2 + 2 * count:
            return None
        word, *positions = (reply[at] | reply[at + 1] << 8 for at in range(0, len(reply), 2))
        if word >> len(ERRORS) or any(position > _U14[1] for position in positions):
            return None
        pulses_us = tuple(position / PER_US if position else None for position in positions)
        return Health(errors=decode_errors(word), pulses_us=pulses_us)

    def _set(self, command: int, channel: int, field: str, value: int) -> bytes:
        check_channels([channel], self.quirks)
        check_range(field, value, _U14)
        return self.packet(command, channel, *_u14(value))


def _u14(value: int) -> tuple[int, int]:
    return value & 0x7F, value >> 7
