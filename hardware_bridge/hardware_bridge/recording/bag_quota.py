# SPDX-License-Identifier: Apache-2.0
"""How much of what others publish goes into the bag: nobody may fill the disk, or the memory, by talking fast. Knows no ROS."""

from __future__ import annotations

import math

MOST_BYTES = 1_000_000
"""Of one message: twin and travel say nothing longer."""

BYTES_PER_S = 1_000_000
"""Of one topic. Markers at 20 Hz are the most that the stack itself says: 0.2 MB/s."""

MESSAGES_PER_S = 500
"""Of one topic: twice a twin at its fastest."""

BURST_S = 4.0
"""What was not used in so much time may be used at once."""


class Quota:
    """Of one topic.

    Attributes:
        dropped: messages that were over it.
    """

    def __init__(self, bytes_per_s: float = BYTES_PER_S, messages_per_s: float = MESSAGES_PER_S):
        self.dropped = 0
        self._rates = (bytes_per_s, messages_per_s)
        self._left = [rate * BURST_S for rate in self._rates]
        self._at_s = -math.inf

    def takes(self, size: int, now_s: float) -> bool:
        """Whether a message of `size` bytes may be kept, at a time of a steady clock in s."""
        elapsed_s = min(now_s - self._at_s, BURST_S)
        self._at_s = now_s
        self._left = [min(rate * BURST_S, left + rate * elapsed_s) for rate, left in zip(self._rates, self._left, strict=True)]
        cost = (size, 1)
        if size > MOST_BYTES or any(left < used for left, used in zip(self._left, cost, strict=True)):
            self.dropped += 1
            return False
        self._left = [left - used for left, used in zip(self._left, cost, strict=True)]
        return True
