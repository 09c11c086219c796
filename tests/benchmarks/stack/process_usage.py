# SPDX-License-Identifier: Apache-2.0
"""Processor time and memory of processes, as the operating system counts them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import psutil

from tests.benchmarks.stack.metrics import Usage

SAMPLE_S = 0.1
GONE = (psutil.NoSuchProcess, psutil.AccessDenied)


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, in s. Raises psutil.NoSuchProcess."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


@dataclass
class _Seen:
    born_s: float = 0.0
    last_s: float = 0.0
    rss_mb: float = 0.0
    pss_mb: float = 0.0


@dataclass
class Sampler:
    """Looks at processes ten times a second, in a thread of its own, between `with` and its end.

    Attributes:
        find: gives the processes that there are, name → pid; called at every look.
    """

    find: Callable[[], Mapping[str, int]]
    _seen: dict[str, _Seen] = field(default_factory=dict)
    _ending: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> Sampler:
        self._thread = threading.Thread(target=self._run, name="usage", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *details: object) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(SAMPLE_S):
            self.look()

    def look(self, share: bool = False) -> None:
        """Look now. `share`: also at shared pages, which takes some milliseconds a process."""
        with self._lock:
            for name, pid in self.find().items():
                with suppress(*GONE):
                    seen = self._seen.setdefault(name, _Seen())
                    seen.last_s = cpu_s(pid)
                    seen.rss_mb = max(seen.rss_mb, 1e-6 * psutil.Process(pid).memory_info().rss)
                    if share:
                        seen.pss_mb = 1e-6 * psutil.Process(pid).memory_full_info().pss

    def begin(self) -> None:
        """From now on processor time counts as running, no longer as starting."""
        self.look()
        for seen in self._seen.values():
            seen.born_s = seen.last_s

    def usages(self, seconds: float) -> list[Usage]:
        """What was seen, `seconds` after `begin`; the last row is all of it."""
        rows = [
            Usage(name, seen.born_s, (seen.last_s - seen.born_s) / seconds, seen.rss_mb, seen.pss_mb)
            for name, seen in sorted(self._seen.items())
        ]
        whole = (sum(getattr(row, name) for row in rows) for name in ("starting_s", "cpu", "rss_mb", "pss_mb"))
        return [*rows, Usage("all", *whole)]
