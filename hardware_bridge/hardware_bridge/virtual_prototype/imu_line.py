# SPDX-License-Identifier: Apache-2.0
"""The inertial sensor's own serial line: a pty beside the board's, on which it sends what it measures, late and with gaps."""

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from hardware_bridge.errors import PrototypeError
from hardware_bridge.imu.wt901 import Measurement, frames_of
from hardware_bridge.virtual_prototype.inertial_sensor import InertialSensor
from hardware_bridge.virtual_prototype.line_faults import Direction
from hardware_bridge.virtual_prototype.pty_port import PseudoPort

PERIOD_S = 0.01
"""Robot time between measurements, as such sensors are set; a fast prototype's has `LEAST_WALL_S` of wall time between them."""
LEAST_WALL_S = 0.005
LATENCY_S = 0.02
"""Robot time from a measurement to its bytes; stand-in."""
GAP_EACH_S, GAP_S = 20.0, 0.08
"""Robot time between gaps, drawn, and how long they are, as of a radio link; stand-in."""
_log = logging.getLogger(__name__)


class ImuLine:
    """Sends from construction to `close`. Times are robot time in [s].

    Args:
        link: where its pty is linked.
        sensor: what measures.
        time_scale: robot seconds per second.

    Raises:
        PrototypeError: the link is taken, or cannot be made.
    """

    def __init__(self, link: Path, sensor: InertialSensor, time_scale: float) -> None:
        self._link = link
        self._sensor = sensor
        self._period_s = max(PERIOD_S, LEAST_WALL_S * time_scale)
        self._port: PseudoPort | None = PseudoPort(link)
        self._line = Direction()
        self._line.delay_s = LATENCY_S
        self._rng = np.random.default_rng(0)
        self._due_s = 0.0
        self._gap_s = self._next_gap_s(0.0)
        self._frozen: bytes | None = None
        self._freezes = False

    def advance(self, now_s: float) -> None:
        """The robot has come so far."""
        while now_s >= self._due_s:
            self._due_s += self._period_s
            self._measure(now_s)
        data = self._line.take(now_s)
        if data and self._port is not None:
            self._port.write(data)

    def _measure(self, now_s: float) -> None:
        rate, acceleration = self._sensor.measure()
        data = frames_of(Measurement(tuple(acceleration), tuple(rate)))
        if self._freezes:
            data = self._frozen = self._frozen or data
        if now_s > self._gap_s + GAP_S:
            self._gap_s = self._next_gap_s(now_s)
        if now_s < self._gap_s:
            self._line.put(data, now_s)

    def _next_gap_s(self, now_s: float) -> float:
        return now_s + float(self._rng.exponential(GAP_EACH_S))

    def fail(self, fault: str, numbers: Mapping[str, float]) -> None:
        """One of the faults of the `fault_client` that begin with imu_."""
        match fault:
            case "imu_unplugged":
                self._unplug()
            case "imu_frozen":
                self._freezes, self._frozen = True, None
            case "imu_turned":
                self._sensor.turn(math.radians(numbers["degrees"]))

    def mend(self) -> None:
        """Neither unplugged nor frozen any more."""
        self._freezes = False
        if self._port is None:
            with suppress(PrototypeError):
                self._port = PseudoPort(self._link)
            if self._port is None:
                _log.warning("%s is taken: the sensor stays unplugged", self._link)

    def close(self) -> None:
        """Removes the link and ends the line."""
        self._unplug()

    def _unplug(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()
