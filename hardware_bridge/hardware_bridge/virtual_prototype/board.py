"""An emulated LSC board: what it makes of bytes, and the pulses that its outputs follow.

It behaves like this, all in robot time:

* Bytes come in at the baud rate, 10 bits each; a frame acts when its last byte is in.
* Nothing is acknowledged; only a battery query is answered.
* The first move of a channel (after power-up or unload) jumps to its pulse; later ones go there linearly over the
  duration, from wherever the output is.
* A frame with a channel or pulse that no LSC accepts is ignored whole, and so are unknown commands.
* After a cut frame the beginning of the next one is taken as the cut one's rest, so both are lost, unless by chance
  they form a valid move. The maker documents no timeout; this is the worse of the two possibilities.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from hardware_bridge.codecs.lsc import (
    CMD_BATTERY,
    Frame,
    FrameDecoder,
    Move,
    decode_move,
    decode_unload,
    encode_battery_reply,
)

BATTERY_MV = 7400
BITS_PER_BYTE = 10


@dataclass(frozen=True)
class Unload:
    """Channels that let go."""

    channels: tuple[int, ...]


class LscBoard:
    """The serial side: bytes in, at the baud rate; replies and orders for the outputs out."""

    def __init__(self, baud: int) -> None:
        self._byte_s = BITS_PER_BYTE / baud
        self._inbox: deque[tuple[float, int]] = deque()
        self._line_free_s = 0.0
        self._decoder = FrameDecoder()
        self.orders: deque[tuple[float, Move | Unload]] = deque()
        """What the outputs must do, with the robot time of each; whoever drives the outputs takes from the left."""

    @property
    def waiting_bytes(self) -> int:
        """Bytes received that are not yet in at the baud rate."""
        return len(self._inbox)

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes put on the line at robot time ``now_s``, behind those already on it."""
        for byte in data:
            self._line_free_s = max(self._line_free_s, now_s) + self._byte_s
            self._inbox.append((self._line_free_s, byte))

    def process(self, now_s: float) -> bytes:
        """Takes in what has arrived until robot time ``now_s``; the reply to it, often empty."""
        reply = b""
        while self._inbox and self._inbox[0][0] <= now_s:
            time_s, byte = self._inbox.popleft()
            for frame in self._decoder.feed(bytes((byte,))):
                reply += self._obey(frame, time_s)
        return reply

    def _obey(self, frame: Frame, time_s: float) -> bytes:
        if (move := decode_move(frame)) is not None:
            self.orders.append((time_s, move))
        elif (channels := decode_unload(frame)) is not None:
            self.orders.append((time_s, Unload(channels)))
        elif frame == Frame(CMD_BATTERY, b""):
            return encode_battery_reply(BATTERY_MV)
        return b""


@dataclass(frozen=True)
class _Ramp:
    start_us: float
    end_us: float
    start_s: float
    duration_s: float

    def at(self, time_s: float) -> float:
        if self.duration_s <= 0 or time_s >= self.start_s + self.duration_s:
            return self.end_us
        part = max(0.0, (time_s - self.start_s) / self.duration_s)
        return self.start_us + part * (self.end_us - self.start_us)


class Outputs:
    """The pulse outputs: each follows its newest move."""

    def __init__(self) -> None:
        self._ramps: dict[int, _Ramp] = {}

    def follow(self, order: Move | Unload, time_s: float) -> None:
        """Begins a move, or lets channels go, at robot time ``time_s``."""
        if isinstance(order, Unload):
            for channel in order.channels:
                self._ramps.pop(channel, None)
            return
        for channel, pulse_us in zip(order.channels, order.pulses_us, strict=True):
            ramp = self._ramps.get(channel)
            if ramp is None:  # the first move ignores its duration
                self._ramps[channel] = _Ramp(pulse_us, pulse_us, time_s, 0.0)
            else:
                self._ramps[channel] = _Ramp(ramp.at(time_s), pulse_us, time_s, order.duration_ms * 1e-3)

    def pulse_us(self, channel: int, time_s: float) -> float:
        """Pulse of a channel at robot time ``time_s``; NaN while it gives none."""
        ramp = self._ramps.get(channel)
        return math.nan if ramp is None else ramp.at(time_s)
