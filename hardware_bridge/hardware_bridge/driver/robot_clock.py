# SPDX-License-Identifier: Apache-2.0
"""Robot time: the steady clock since the port was opened, times the time scale."""

import time

from hardware_bridge.safety.supervisor_messages import Now


class RobotClock:
    """Whole nanoseconds of robot time; never goes back, whatever happens to the wall clock.

    Attributes:
        time_scale: robot seconds per second of the steady clock.
    """

    def __init__(self, time_scale: float = 1.0) -> None:
        self.time_scale = time_scale
        self._start_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Robot time in [ns]."""
        return int((time.monotonic_ns() - self._start_ns) * self.time_scale)

    def now(self) -> Now:
        """This instant in robot time and in seconds of the steady clock."""
        steady_ns = time.monotonic_ns()
        return Now((steady_ns - self._start_ns) * self.time_scale * 1e-9, steady_ns * 1e-9)
