# SPDX-License-Identifier: Apache-2.0
"""Where a board's outputs are, by the frames that it was handed: the last gate's own account, beside the supervisor's."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

MoveTime = Callable[[float, int], float]
"""How long in [s] a board takes for a way in [us] when it is told a duration in [ms]."""


@dataclass(frozen=True)
class _Ramp:
    start_us: float
    end_us: float
    start_s: float
    end_s: float

    def at(self, now_s: float) -> float:
        if now_s >= self.end_s:
            return self.end_us
        return self.start_us + max(0.0, now_s - self.start_s) / (self.end_s - self.start_s) * (self.end_us - self.start_us)


class BoardTrack:
    """One ramp a strut, from where its output was when a frame was handed over.

    No board tells where it is. If it does what it is told, it is here, only later by what the line takes.
    """

    def __init__(self, move_time: MoveTime) -> None:
        self._move_time = move_time
        self._ramps: dict[int, _Ramp] = {}

    def forget(self) -> None:
        """Nobody knows: the port was opened anew, or the board has lost its pulses."""
        self._ramps.clear()

    def sent(self, struts: Sequence[int], pulses_us: Sequence[int], duration_ms: int, now_s: float) -> None:
        """A frame was handed over at robot time `now_s`: `struts` (from 0) to their entries of the six `pulses_us`."""
        for index in struts:
            ramp = self._ramps.get(index)
            at_us = float(pulses_us[index]) if ramp is None else ramp.at(now_s)
            end_s = now_s + self._move_time(abs(pulses_us[index] - at_us), duration_ms)
            self._ramps[index] = _Ramp(at_us, float(pulses_us[index]), now_s, end_s)

    def at_us(self, now_s: float, count: int = 6) -> tuple[float | None, ...]:
        """The pulse that each of the struts is given at robot time `now_s`; None: never sent."""
        return tuple(None if (ramp := self._ramps.get(index)) is None else ramp.at(now_s) for index in range(count))
