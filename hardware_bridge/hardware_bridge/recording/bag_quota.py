# SPDX-License-Identifier: Apache-2.0
"""How much of what others publish goes into the bag: nobody may fill the disk, or the memory, by talking fast. Knows no ROS."""

import time
from collections.abc import Callable

MOST_BYTES = 1_000_000
"""Of one message: twin and travel say nothing longer."""

BYTES_PER_S = 1_000_000
"""Of one topic. Markers at 20 Hz are the most that the stack itself says: 0.2 MB/s."""

MESSAGES_PER_S = 500
"""Of one topic: twice a twin at its fastest."""

BURST_S = 4.0
"""What was not used in so much time may be used at once."""


class RateLimit:
    """How often something may happen: so many at once, and so many a second. Args: clock: steady, in s."""

    def __init__(self, at_once: float, per_s: float, clock: Callable[[], float] = time.monotonic):
        self._most, self._per_s, self._clock = at_once, per_s, clock
        self._left, self._looked_s = at_once, clock()

    def has(self, cost: float) -> bool:
        """Whether so much is within it now."""
        now_s = self._clock()
        self._left = min(self._most, self._left + self._per_s * (now_s - self._looked_s))
        self._looked_s = now_s
        return self._left >= cost

    def allows(self, cost: float = 1.0) -> bool:
        """Whether so much is within it now; then it is used."""
        if not self.has(cost):
            return False
        self._left -= cost
        return True


class Quota:
    """Of one topic.

    Attributes:
        dropped: messages that were over it.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._now_s = 0.0
        self._bytes = RateLimit(BYTES_PER_S * BURST_S, BYTES_PER_S, lambda: self._now_s)
        self._messages = RateLimit(MESSAGES_PER_S * BURST_S, MESSAGES_PER_S, lambda: self._now_s)

    def takes(self, size: int, now_s: float) -> bool:
        """Whether a message of `size` bytes may be kept, at a time of a steady clock in s."""
        self._now_s = now_s
        if size <= MOST_BYTES and self._messages.has(1) and self._bytes.allows(size):
            return self._messages.allows()
        self.dropped += 1
        return False
