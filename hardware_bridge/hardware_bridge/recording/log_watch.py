# SPDX-License-Identifier: Apache-2.0
"""Whether the bag grows and has room to. Knows no ROS."""

import shutil
from collections.abc import Callable
from pathlib import Path

from hardware_bridge.recording.session_bag import SessionLog

STUCK_S = 2.0
"""Messages that wait for so long while none is written: the disk takes nothing."""


def free_mb(folder: Path) -> float:
    """Free space for us where a folder is, in MB. Raises OSError."""
    return shutil.disk_usage(folder).free * 1e-6


class LogWatch:
    """Looks at a bag now and then.

    Args:
        log: the open bag.
        limit_mb: free space below which there is trouble, in MB.
        free: gives the free space where a folder is, in MB.

    Attributes:
        trouble: why nothing may be moved with this bag; empty: it is well.
        free_mb: free space when last looked.
    """

    def __init__(self, log: SessionLog, limit_mb: float, free: Callable[[Path], float] = free_mb):
        assert log.path is not None
        self._log = log
        self._folder = log.path.parent
        self._limit_mb = limit_mb
        self._free = free
        self._messages = -1
        self._grew_s: float | None = None
        self.trouble = ""
        self.free_mb = float("nan")

    def look(self, now_s: float) -> str:
        """The trouble at a time of the steady clock, in s."""
        self.trouble = self._dead() or self._full() or self._stuck(now_s)
        return self.trouble

    def _dead(self) -> str:
        if not self._log.fault:
            return ""
        return f"the log is dead ({self._log.fault}): start the bridge again, or without a log (record:=false)"

    def _full(self) -> str:
        try:
            self.free_mb = self._free(self._folder)
        except OSError as error:
            return f"nobody knows the free space in {self._folder} ({error.strerror}): is the disk still there?"
        if self.free_mb >= self._limit_mb:
            return ""
        return (
            f"{self.free_mb:.0f} MB are free in {self._folder}, the limit is {self._limit_mb:.0f} MB (space_limit_mb): free space, "
            "or start the bridge with another bag_folder, or without a log (record:=false)"
        )

    def _stuck(self, now_s: float) -> str:
        messages = self._log.messages
        if messages != self._messages or not self._log.waiting or self._grew_s is None:
            self._messages, self._grew_s = messages, now_s
        if now_s - self._grew_s < STUCK_S:
            return ""
        return f"the log has not grown for {now_s - self._grew_s:.0f} s and {self._log.waiting} messages wait: check the disk"
