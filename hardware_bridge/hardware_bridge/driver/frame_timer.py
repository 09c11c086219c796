# SPDX-License-Identifier: Apache-2.0
"""Calls a function at absolute steady deadlines. A missed deadline is counted and dropped, never made up for."""

import logging
import math
import threading
import time
from collections.abc import Callable

_log = logging.getLogger(__name__)


class Streamer:
    """A thread that calls `tick(missed)` every `period_s` of wall time.

    `missed` is the number of deadlines that passed by since the last call. What a late call sends is the newest due
    frame: the frames between are stale and never exist. `tick` must not raise; if it does, `failed` is told and the
    thread goes on, because somebody has to notice the lost lease.
    """

    def __init__(
        self, tick: Callable[[int], None], failed: Callable[[Exception], None], period_s: float, name: str = "bridge frames"
    ) -> None:
        self._tick = tick
        self._failed = failed
        self._period_s = period_s
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begins; the first call comes after one period."""
        self._thread.start()

    def stop(self) -> None:
        """Ends and waits for a running `tick`. Not from within `tick`."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        deadline = time.monotonic()
        while True:
            deadline += self._period_s
            missed = max(0, math.floor((time.monotonic() - deadline) / self._period_s))
            deadline += missed * self._period_s
            if self._ending.wait(max(0.0, deadline - time.monotonic())):
                return
            try:
                self._tick(missed)
            except Exception as error:
                _log.exception(self._thread.name)
                self._failed(error)
