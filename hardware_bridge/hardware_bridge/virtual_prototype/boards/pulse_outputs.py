# SPDX-License-Identifier: Apache-2.0
"""Pulse outputs of an emulated board: what a channel gives at any robot time, after the orders it has got."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Timed:
    """Channels that go straight to their pulses within a duration, and arrive together."""

    channels: tuple[int, ...]
    pulses_us: tuple[float, ...]
    duration_s: float


@dataclass(frozen=True)
class Paced:
    """A channel that goes to a pulse at a speed in [us/s]; 0: at once."""

    channel: int
    pulse_us: float
    speed_us_s: float


@dataclass(frozen=True)
class Off:
    """Channels that give no pulse any more: they let go, and their next order jumps."""

    channels: tuple[int, ...]


@dataclass(frozen=True)
class Freeze:
    """A channel that stays at the pulse that it gives now."""

    channel: int


@dataclass(frozen=True)
class Reset:
    """All channels off: the board has lost its power for a moment."""


Order = Timed | Paced | Off | Freeze | Reset


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
    """Each channel follows its newest order. The first one after power-up or release jumps: no board knows where from."""

    def __init__(self) -> None:
        self._ramps: dict[int, _Ramp] = {}

    def follow(self, order: Order, time_s: float) -> None:
        """Begins an order at robot time `time_s`."""
        match order:
            case Timed(channels, pulses_us, duration_s):
                for channel, pulse_us in zip(channels, pulses_us, strict=True):
                    self._begin(channel, pulse_us, time_s, duration_s)
            case Paced(channel, pulse_us, speed_us_s):
                at_us = self.pulse_us(channel, time_s)
                duration_s = abs(pulse_us - at_us) / speed_us_s if speed_us_s > 0 else 0.0
                self._begin(channel, pulse_us, time_s, duration_s)
            case Off(channels):
                for channel in channels:
                    self._ramps.pop(channel, None)
            case Freeze(channel):
                if channel in self._ramps:
                    self._begin(channel, self.pulse_us(channel, time_s), time_s, 0.0)
            case Reset():
                self._ramps.clear()

    def _begin(self, channel: int, pulse_us: float, time_s: float, duration_s: float) -> None:
        at_us = self.pulse_us(channel, time_s)
        if math.isnan(at_us):
            at_us, duration_s = pulse_us, 0.0
        self._ramps[channel] = _Ramp(at_us, pulse_us, time_s, duration_s)

    def pulse_us(self, channel: int, time_s: float) -> float:
        """Pulse of a channel at robot time `time_s`; NaN while it gives none."""
        ramp = self._ramps.get(channel)
        return math.nan if ramp is None else ramp.at(time_s)

    def is_moving(self, time_s: float) -> bool:
        """Whether any channel is still on its way."""
        return any(ramp.at(time_s) != ramp.end_us for ramp in self._ramps.values())
