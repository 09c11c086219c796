# SPDX-License-Identifier: Apache-2.0
"""What may be asked of the struts, as numbers, and how fast frames go out."""

import math
from dataclasses import dataclass, field, fields
from typing import Any

from hardware_bridge.errors import ParameterError


def _number(default: float, low: float, high: float) -> Any:
    return field(default=default, metadata={"range": (low, high)})


@dataclass(frozen=True)
class _Ranged:
    """Refuses values outside their ranges when constructed."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value, (low, high) = getattr(self, each.name), each.metadata["range"]
            number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not number or not low <= value <= high:
                raise ParameterError(each.name, value, f"{low:g} to {high:g}")


@dataclass(frozen=True)
class Limits(_Ranged):
    """Limits of every command.

    Attributes:
        stroke_m: largest change from mid stroke, either way, in [m]: the policy bound.
        speed_m_s: largest speed of a rest length, in [m/s] of robot time.
        step_m: largest change of a rest length in one frame, in [m].
        goal_age_s: oldest stamp of a goal, in [s] of wall time.
        duty_fraction: part of a window that a strut may run; its actuator's maker permits 0.2.
        duty_window_s: that window, in [s] of robot time: of one minute in five, ten minutes make two.
        burst_fraction: as `duty_fraction`, of a short window: nothing runs through the whole of the minute in five.
        burst_window_s: that window, in [s] of robot time.
        back_drive_n: axial force of a strut, either way, that its actuator holds without power, in [N]. Held against more, it runs.
        supply_low_v: servo supply below which no motion that loads the struts is begun, in [V]. A board that does not tell its
            supply is not judged.
        lease_silence_s: longest silence of the lease's holder, in [s] of wall time: it is a process that must prove its life,
            whatever the pace of the robot. With a time scale, which only a virtual port has, this is so many times longer in robot
            time.
    """

    stroke_m: float = _number(0.045, 0.001, 0.100)
    speed_m_s: float = _number(0.020, 0.001, 0.100)
    step_m: float = _number(0.002, 0.0002, 0.010)
    goal_age_s: float = _number(0.5, 0.05, 5.0)
    lease_silence_s: float = _number(1.0, 0.2, 10.0)
    duty_fraction: float = _number(0.2, 0.01, 1.0)
    duty_window_s: float = _number(600.0, 10.0, 3600.0)
    burst_fraction: float = _number(0.9, 0.01, 1.0)
    burst_window_s: float = _number(60.0, 5.0, 600.0)
    back_drive_n: float = _number(46.0, 0.1, 1e5)
    supply_low_v: float = _number(6.4, 0.1, 60.0)

    @property
    def duty_s(self) -> float:
        """How long a strut may run within the long window, in [s] of robot time."""
        return self.duty_fraction * self.duty_window_s

    @property
    def duty_windows(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Both windows, and how long a strut may run within each, in [s] of robot time."""
        return (self.duty_window_s, self.duty_s), (self.burst_window_s, self.burst_fraction * self.burst_window_s)

    @property
    def longest_window_s(self) -> float:
        """What ran longer ago counts nowhere, in [s] of robot time."""
        return max(self.duty_window_s, self.burst_window_s)


@dataclass(frozen=True)
class Pacing(_Ranged):
    """How motions are cut into frames; all times in robot time.

    Attributes:
        period_s: time between frames, and between heartbeats. A frame of six servos lasts 26 ms at 9600 baud.
        overlap: duration of a frame's move over the period. Above 1, so that the board is still moving when the next frame arrives;
            close to 1, so that little motion is left when the link dies.
        homing_speed_m_s: speed of the slow move to mid stroke, in [m/s].
        energise_pause_s: rest after each strut is energised, in [s].
    """

    period_s: float = _number(0.050, 0.030, 0.5)
    overlap: float = _number(1.1, 1.0, 2.0)
    homing_speed_m_s: float = _number(0.008, 0.0005, 0.020)
    energise_pause_s: float = _number(0.4, 0.0, 5.0)
