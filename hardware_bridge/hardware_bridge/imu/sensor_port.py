# SPDX-License-Identifier: Apache-2.0
"""A sensor behind a serial port: its measurements, each with the time at which it was made, as well as that can be known."""

import math
import select
import time
from collections import deque

from hardware_bridge.errors import LinkLost
from hardware_bridge.imu.wt901 import FrameDecoder, Measurement, Rounds
from hardware_bridge.link.transport import SerialTransport

USUAL_BAUD = 115200
_MOST_BYTES = 4096
_SOCKET_PERIOD_S = 0.005
WINDOW_S, LEAST = 2.0, 20
"""The pace is the mean of so much time, and of so many measurements at least; before, they count as made when they come."""
LATE_PERIODS = 3.0
"""Later than this, a measurement was delayed on its way, or others before it were lost."""
LOST_S = 0.5
"""Farther from when they come, times are not believed any more."""
PULL, PULL_EARLY = 0.05, 0.2
"""Part of what a measurement is late or early by that its time follows; none comes before it is made."""


class EvenStamps:
    """When measurements were made: a sensor makes them evenly, and a link delivers them in bursts, or loses some.

    Delayed ones come close upon each other when they come at last, and keep their even times. Where some were lost the next ones
    come at their usual pace, and the times jump: so who integrates rates sees the gap.
    """

    def __init__(self) -> None:
        self._came: deque[float] = deque()
        self._stamp_s = -math.inf

    def stamp(self, came_s: float) -> float:
        """When a measurement was made that came then, in [s]; later than the one before."""
        came = self._came
        interval_s = came_s - came[-1] if came else math.inf
        came.append(came_s)
        while came[0] < came_s - WINDOW_S:
            came.popleft()
        self._stamp_s = max(self._stamp_s + 1e-6, self._made_s(came_s, interval_s))
        return self._stamp_s

    def _made_s(self, came_s: float, interval_s: float) -> float:
        if len(self._came) < LEAST:
            return came_s
        period_s = (came_s - self._came[0]) / (len(self._came) - 1)
        late_s = came_s - self._stamp_s - period_s
        lost = late_s > LATE_PERIODS * period_s and 0.5 * period_s < interval_s < LATE_PERIODS * period_s
        if lost or abs(late_s) > LOST_S:
            return came_s
        error_s = max(-period_s, min(period_s, late_s))
        return self._stamp_s + period_s + (PULL if error_s > 0.0 else PULL_EARLY) * error_s


class SensorPort:
    """An open port. Of one thread.

    Attributes:
        measurements: so far.
    """

    def __init__(self, port: str, baud: int = 0) -> None:
        """Opens it; what waited there is old, and thrown away. Raises PortMissing, PortBusy, PortWrongKind."""
        self._transport = SerialTransport(port, baud or USUAL_BAUD)
        self._transport.open()
        self._decoder, self._rounds, self._stamps = FrameDecoder(), Rounds(), EvenStamps()
        self.measurements = 0
        while len(self._transport.read_available(_MOST_BYTES)) == _MOST_BYTES:
            pass

    @property
    def bad_bytes(self) -> int:
        """That belonged to no frame."""
        return self._decoder.bad

    def read(self, wait_s: float) -> list[tuple[float, Measurement]]:
        """What came, with its time (time.monotonic), as soon as something does, or after `wait_s`. Raises LinkLost."""
        descriptor = self._transport.descriptor
        if descriptor is None:
            time.sleep(min(wait_s, _SOCKET_PERIOD_S))
        elif not select.select([descriptor], [], [], wait_s)[0]:
            return []
        data, now_s = self._transport.read_available(_MOST_BYTES), time.monotonic()
        if descriptor is not None and not data:
            raise LinkLost(self._transport.port, "ended", "plug the sensor in again")
        found = [done for frame in self._decoder.feed(data) if (done := self._rounds.take(frame)) is not None]
        self.measurements += len(found)
        return [(self._stamps.stamp(now_s), measurement) for measurement in found]

    def close(self) -> None:
        """Lets go of the port."""
        self._transport.close()
