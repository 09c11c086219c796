# SPDX-License-Identifier: Apache-2.0
"""How late a virtual prototype is on a busy computer: its body is behind, or it took its orders too late."""

import os
import time

from hardware_bridge.prototype_client.observation import Observation

BUSY = 1.5
"""Load a processor from which on a stack, which itself needs about one, cannot keep its times."""
LATE_S = 1.0
"""A virtual prototype that took its orders later than this (s of robot time) has not done what it was told."""


def busy_text() -> str:
    """Whether others keep this computer from the work here, for people; empty: they do not."""
    load, processors = os.getloadavg()[0], len(os.sched_getaffinity(0))
    return f"this computer is busy (load {load:.1f} on {processors} processors)" if load > BUSY * processors else ""


class Lateness:
    """How far what is seen is behind: compares the robot time of observations with the clock. They may come in another thread.

    Attributes:
        late_s: how late the newest observation is, against the least late one so far (s of wall time).
    """

    def __init__(self, time_scale: float):
        """Args: time_scale: robot seconds per second."""
        self._time_scale = time_scale
        self._least_s = float("inf")
        self.late_s = 0.0

    def saw(self, robot_time_ns: int) -> None:
        """An observation of that robot time came just now."""
        offset_s = time.monotonic() - robot_time_ns * 1e-9 / self._time_scale
        self._least_s = min(self._least_s, offset_s)
        self.late_s = offset_s - self._least_s


class LateOrders:
    """How late a virtual prototype took its orders, by its own word. Observations may come in another thread.

    A body that is only behind falsifies nothing: orders keep their time, and rest from before the last frame is not believed.

    Attributes:
        worst_s: the latest since `forget` (s of robot time).
    """

    def __init__(self) -> None:
        self.worst_s = 0.0

    def saw(self, observation: Observation) -> None:
        """One more observation."""
        self.worst_s = max(self.worst_s, observation.late_s)

    def forget(self) -> None:
        """Begin anew to look for the worst."""
        self.worst_s = 0.0

    def too_late(self, time_scale: float) -> str:
        """Why what the virtual prototype did does not count; empty: it was in time. `time_scale`: robot seconds per second."""
        if self.worst_s <= LATE_S:
            return ""
        return (
            f"the virtual prototype took its orders {self.worst_s:.1f} s of robot time late: this computer is too busy for "
            f"--time-scale {time_scale:g}; lower it"
        )
