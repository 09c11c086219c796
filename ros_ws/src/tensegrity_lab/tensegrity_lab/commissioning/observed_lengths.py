# SPDX-License-Identifier: Apache-2.0
"""Strut lengths as the virtual prototype's observer sees them, for calibrating it; a bridge has its own, `bridge.observer`."""

import threading
import time

import numpy as np

from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from sim_core.structure.topology import STRUTS
from tensegrity_lab.stack.simulation_lag import Lateness

REST_LIMIT_S = 20.0
LATE_S = 0.2
"""A simulation no later than this is on time."""


class Eyes:
    """What the virtual prototype's observer sees of the struts."""

    def __init__(self, observer: str, time_scale: float):
        self._lateness = Lateness(time_scale)
        self._news = threading.Condition()
        self._newest: Observation | None = None
        self._client = ObserverClient(observer, self._see)

    def close(self) -> None:
        """Look no longer."""
        self._client.close()

    def length_mm(self, strut: str) -> float | None:
        """Distance between a strut's nodes now, to 0.1 mm, once the robot is at rest; None: it was not seen."""
        asked_s, first, second = time.monotonic(), *STRUTS[int(strut[1:]) - 1]
        with self._news:
            self._news.wait_for(lambda: self._is_at_rest(asked_s), REST_LIMIT_S)
            if self._newest is None:
                return None
            joints_m = self._newest.joints_m
        return round(1e3 * float(np.linalg.norm(joints_m[second] - joints_m[first])), 1)

    def _is_at_rest(self, since_s: float) -> bool:
        """At rest, and seen since then: what is simulated may be late, and rest before a motion that is still to come."""
        if self._newest is None or not self._newest.settled:
            return False
        late_s = self._lateness.late_s
        return late_s < LATE_S and time.monotonic() - since_s > late_s + LATE_S

    def _see(self, observation: Observation) -> None:
        with self._news:
            self._newest = observation
            self._lateness.saw(observation.robot_time_ns)
            self._news.notify_all()
