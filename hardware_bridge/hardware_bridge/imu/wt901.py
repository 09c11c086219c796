# SPDX-License-Identifier: Apache-2.0
"""WitMotion WT901 and its family over serial: frames of 11 bytes, `55 type d0..d7 sum`, little-endian; it sends, nobody asks.

Source: WitMotion, "WT901 datasheet" v20-0702, chapter 5.1. The sum is the low byte of that of the ten bytes before it.
"""

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

GRAVITY_M_S2 = 9.80665
HEADER = 0x55
ACCELERATION, RATE, ANGLES, QUATERNION = 0x51, 0x52, 0x53, 0x59
TYPES = range(0x50, 0x5B)
"""Of frames that the family sends: time, the four above, magnetic field, ports, pressure, place, speed, satellites."""
LENGTH = 11
RANGE_M_S2, RANGE_RAD_S = 16.0 * GRAVITY_M_S2, math.radians(2000.0)
_FULL = 32768.0
_FOUR = struct.Struct("<4h")


class Frame(NamedTuple):
    """A frame whose sum is right. Attributes: kind: its type. words: four signed numbers of 16 bits."""

    kind: int
    words: tuple[int, int, int, int]


def encode_frame(kind: int, words: tuple[int, int, int, int]) -> bytes:
    """Bytes of a frame. Raises ValueError: no such type, or a number of more than 16 bits."""
    if kind not in TYPES:
        raise ValueError(f"type {kind:#x}: valid is {TYPES[0]:#x} to {TYPES[-1]:#x}")
    try:
        body = bytes((HEADER, kind)) + _FOUR.pack(*words)
    except struct.error as error:
        raise ValueError(f"words {words}: valid is -32768 to 32767 each") from error
    return body + bytes((sum(body) & 0xFF,))


class FrameDecoder:
    """Finds frames in a stream that arrives in pieces of any size. Survives any bytes.

    Attributes:
        bad: bytes that belonged to no frame.
    """

    def __init__(self) -> None:
        self._rest = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete now."""
        self._rest += data
        found, at = list[Frame](), 0
        while len(self._rest) - at >= LENGTH:
            piece = self._rest[at : at + LENGTH]
            if piece[0] == HEADER and piece[1] in TYPES and sum(piece[:-1]) & 0xFF == piece[-1]:
                found.append(Frame(piece[1], _FOUR.unpack_from(piece, 2)))
                at += LENGTH
            else:
                at += 1
                self.bad += 1
        del self._rest[:at]
        return found


@dataclass(frozen=True)
class Measurement:
    """One round of frames.

    Attributes:
        acceleration_m_s2: (3,) in the sensor's axes, upward at rest.
        rate_rad_s: of turn, (3,).
        quaternion: of the sensor by its own reckoning, (w, x, y, z); None: it does not send it.
    """

    acceleration_m_s2: tuple[float, float, float]
    rate_rad_s: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] | None = None


class Rounds:
    """Joins frames to measurements: a round begins with an acceleration and is told when the next one begins."""

    def __init__(self) -> None:
        self._round: dict[int, Frame] = {}

    def take(self, frame: Frame) -> Measurement | None:
        """The round that this frame ends by beginning the next; None: none, or one that lacks its rates."""
        if frame.kind != ACCELERATION:
            self._round[frame.kind] = frame
            return None
        done, self._round = self._round, {ACCELERATION: frame}
        if ACCELERATION not in done or RATE not in done:
            return None
        x, y, z, _ = (word / _FULL * RANGE_M_S2 for word in done[ACCELERATION].words)
        p, q, r, _ = (word / _FULL * RANGE_RAD_S for word in done[RATE].words)
        turn = done.get(QUATERNION)
        a, b, c, d = (word / _FULL for word in turn.words) if turn else (0.0, 0.0, 0.0, 0.0)
        return Measurement((x, y, z), (p, q, r), (a, b, c, d) if turn else None)


def frames_of(measurement: Measurement) -> bytes:
    """What a sensor sends of a measurement: acceleration, rate and, if there is one, quaternion; saturated at its ranges."""
    frames = [
        (ACCELERATION, [value / RANGE_M_S2 for value in measurement.acceleration_m_s2]),
        (RATE, [value / RANGE_RAD_S for value in measurement.rate_rad_s]),
    ]
    if measurement.quaternion is not None:
        frames.append((QUATERNION, list(measurement.quaternion)))
    sent = bytearray()
    for kind, values in frames:
        words = [max(-32768, min(32767, round(value * _FULL))) for value in values]
        a, b, c, d = (*words, 0)[:4]
        sent += encode_frame(kind, (a, b, c, d))
    return bytes(sent)
