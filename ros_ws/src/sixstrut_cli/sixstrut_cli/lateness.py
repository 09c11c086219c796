"""How late a virtual prototype is: on a busy computer its body falls behind, and what is seen of it is older than it looks."""

from __future__ import annotations

import time


class Lateness:
    """Compares the robot time of observations with the clock. They may come in another thread.

    Attributes:
        late_s: how late the newest observation is, against the least late one so far (s of wall time).
        worst_s: the largest of these since `forget`.
    """

    def __init__(self, time_scale: float):
        """Args: time_scale: robot seconds per second."""
        self._time_scale = time_scale
        self._least_s = float("inf")
        self.late_s = self.worst_s = 0.0

    def saw(self, robot_time_ns: int) -> None:
        """An observation of that robot time came just now."""
        offset_s = time.monotonic() - robot_time_ns * 1e-9 / self._time_scale
        self._least_s = min(self._least_s, offset_s)
        self.late_s = offset_s - self._least_s
        self.worst_s = max(self.worst_s, self.late_s)

    def forget(self) -> None:
        """Begin anew to look for the worst."""
        self.worst_s = self.late_s
