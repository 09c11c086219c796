# SPDX-License-Identifier: Apache-2.0
"""Per strut: rest length in m to pulse in µs and back."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class StrutCalibration:
    """One strut's actuator.

    Attributes:
        channel: the board's channel.
        pulse_at_zero_us: pulse at zero stroke before the trim, in [us].
        us_per_mm: slope, always positive, in [us/mm].
        direction: +1 if a longer pulse lengthens the strut, else -1.
        trim_us: added to every pulse, in [us].
        stroke_mm: shortest and longest stroke that the actuator may take, in [mm]; zero lies inside.
        pulse_us: shortest and longest pulse that may be sent, in [us].
    """

    channel: int
    pulse_at_zero_us: int
    us_per_mm: float
    direction: int
    trim_us: int
    stroke_mm: tuple[float, float]
    pulse_us: tuple[int, int]

    def stroke_to_pulse(self, stroke_m: float) -> int:
        """Nearest whole pulse in [us]; halves go up. Says nothing about limits."""
        exact = self.pulse_at_zero_us + self.trim_us + self.direction * self.us_per_mm * stroke_m * 1e3
        return math.floor(exact + 0.5)

    def pulse_to_stroke(self, pulse_us: float) -> float:
        """The stroke in [m] that a pulse stands for."""
        return (pulse_us - self.pulse_at_zero_us - self.trim_us) / (self.direction * self.us_per_mm) * 1e-3

    @property
    def quantum_m(self) -> float:
        """Change of length for one µs, in [m]."""
        return 1e-3 / self.us_per_mm


@dataclass(frozen=True)
class Calibration:
    """Six struts, S1 first.

    Attributes:
        mid_stroke_length_m: rest length at zero stroke, in [m].
        struts: six `StrutCalibration`.
        board: name of the board that it was measured with; None: the file does not say.
        robot: name of the robot; None: the file does not say, and nothing is remembered of a real one.
    """

    mid_stroke_length_m: float
    struts: tuple[StrutCalibration, ...]
    board: str | None = None
    robot: str | None = None

    @property
    def channels(self) -> tuple[int, ...]:
        """The board's channels of S1 to S6."""
        return tuple(strut.channel for strut in self.struts)

    def pulse_us(self, index: int, length_m: float) -> int:
        """Whole pulse in [us] for the rest length in [m] of strut `index` (from 0)."""
        return self.struts[index].stroke_to_pulse(length_m - self.mid_stroke_length_m)

    def length_m(self, index: int, pulse_us: float) -> float:
        """Rest length in [m] that `pulse_us` really asks strut `index` (from 0) for."""
        return self.mid_stroke_length_m + self.struts[index].pulse_to_stroke(pulse_us)

    def pulses_us(self, lengths_m: Sequence[float]) -> tuple[int, ...]:
        """Six pulses in [us] for six rest lengths in [m]."""
        return tuple(self.pulse_us(index, length) for index, length in enumerate(lengths_m))

    def lengths_m(self, pulses_us: Sequence[int]) -> tuple[float, ...]:
        """Six rest lengths in [m] that six pulses really ask for."""
        return tuple(self.length_m(index, pulse) for index, pulse in enumerate(pulses_us))

    @property
    def hash(self) -> str:
        """sha256 over names and numbers, in hexadecimal: equal for equal calibrations, whatever the file looks like."""
        values = {key: value for key, value in asdict(self).items() if value is not None}
        text = json.dumps(values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()
