# SPDX-License-Identifier: Apache-2.0
"""Handle of a motion that the bridge has accepted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from hardware_bridge.safety.supervisor_messages import MotionOutcome


@dataclass(frozen=True)
class Progress:
    """How far a motion is.

    Attributes:
        fraction: part of its path that has been sent, 0 to 1.
        elapsed_s: the same in robot time, in [s].
        duration_s: robot time of the whole path, in [s].
        lengths_m: rest lengths last sent, in [m].
    """

    fraction: float
    elapsed_s: float
    duration_s: float
    lengths_m: tuple[float, ...]


@dataclass(frozen=True)
class MotionResult:
    """How a motion ended.

    Attributes:
        outcome: `done`: every knot was sent and the board has had the time for it; `held`; `fault`; `overtaken`: another motion
            took its place.
        reason: for people; empty if done.
        lengths_m: rest lengths last sent, in [m].
    """

    outcome: MotionOutcome
    reason: str
    lengths_m: tuple[float, ...]

    @property
    def success(self) -> bool:
        """Whether the whole trajectory was sent."""
        return self.outcome is MotionOutcome.DONE


class MotionHandle:
    """An accepted motion. All methods may be called from any thread.

    Attributes:
        number: its identity, from 1.
        duration_s: robot time of the whole path, in [s].
        sent_s: for the bridge: path time of the newest frame that `progress` has seen.
    """

    def __init__(
        self,
        number: int,
        duration_s: float,
        progress: Callable[[MotionHandle], Progress],
        cancel: Callable[[int, str], None],
    ) -> None:
        self.number = number
        self.duration_s = duration_s
        self.sent_s = 0.0
        self._progress = progress
        self._cancel = cancel
        self._ended = threading.Event()
        self._result: MotionResult | None = None

    def progress(self) -> Progress:
        """How far it is."""
        return self._progress(self)

    def progress_at(self, sent_s: float | None, lengths_m: tuple[float, ...]) -> Progress:
        """For the bridge: its progress, by the path time of its newest frame (None: that has not been seen) and the lengths."""
        if self._result is not None and self._result.success:
            sent_s = self.duration_s
        self.sent_s = self.sent_s if sent_s is None else sent_s
        fraction = 1.0 if self.duration_s == 0 else self.sent_s / self.duration_s
        return Progress(fraction, self.sent_s, self.duration_s, lengths_m)

    def cancel(self, reason: str = "cancelled") -> None:
        """Holds the struts where they are and ends the motion as `held`; too late, it does nothing."""
        self._cancel(self.number, reason)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Waits for the end in wall time; whether it has come."""
        return self._ended.wait(timeout_s)

    def result(self) -> MotionResult | None:
        """How it ended, or None while it runs."""
        return self._result

    def finish(self, result: MotionResult) -> None:
        """For the bridge: sets the result, once."""
        if self._result is None:
            self._result = result
            self._ended.set()
