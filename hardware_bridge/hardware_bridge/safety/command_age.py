# SPDX-License-Identifier: Apache-2.0
"""How old a command is by the time that it is accepted, and not only when it came."""

import time
from collections.abc import Callable


class Age:
    """A clock for one command; steady, so that no setting of the time makes it younger.

    Args:
        on_receipt_s: its age when it came, by its stamp, in [s]; negative: stamped in the future.
        steady_s: the clock, one for all processes of a computer.
        received_s: when it came, by that clock; None: now.
    """

    def __init__(
        self, on_receipt_s: float, steady_s: Callable[[], float] = time.monotonic, received_s: float | None = None
    ) -> None:
        self._on_receipt_s = on_receipt_s
        self._steady_s = steady_s
        self._received_s = steady_s() if received_s is None else received_s

    def now_s(self) -> float:
        """Its age now; of one that came from the future no less wrong than it was. Not a number if its stamp was none."""
        return max(self._on_receipt_s, self._on_receipt_s + self._steady_s() - self._received_s, key=abs)
