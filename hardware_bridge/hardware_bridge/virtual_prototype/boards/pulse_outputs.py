# SPDX-License-Identifier: Apache-2.0
"""Pulse outputs of an emulated board: what a channel gives at any robot time, after the orders it has got."""

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Order:
    """Outputs that go straight to their pulses, and arrive together.

    Attributes:
        pulses_us: of each channel, in [us]; None: it gives no pulse any more, lets go, and its next order jumps.
        duration_s: how long they take; 0: at once.
    """

    pulses_us: Mapping[int, float | None]
    duration_s: float = 0.0


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
        for channel, pulse_us in order.pulses_us.items():
            at_us = self.pulse_us(channel, time_s)
            if pulse_us is None:
                self._ramps.pop(channel, None)
            elif math.isnan(at_us):
                self._ramps[channel] = _Ramp(pulse_us, pulse_us, time_s, 0.0)
            else:
                self._ramps[channel] = _Ramp(at_us, pulse_us, time_s, order.duration_s)

    @property
    def channels(self) -> tuple[int, ...]:
        """Those that give a pulse."""
        return tuple(self._ramps)

    def pulse_us(self, channel: int, time_s: float) -> float:
        """Pulse of a channel at robot time `time_s`; NaN while it gives none."""
        ramp = self._ramps.get(channel)
        return math.nan if ramp is None else ramp.at(time_s)

    def is_moving(self, time_s: float) -> bool:
        """Whether any channel is still on its way."""
        return any(ramp.at(time_s) != ramp.end_us for ramp in self._ramps.values())
