# SPDX-License-Identifier: Apache-2.0
"""The session's bag: names, what goes with it, and messages that come before it is open. Knows no ROS but its file layout."""

import fcntl
import importlib.metadata
import os
import platform
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO

from hardware_bridge.errors import BridgeError, RecorderError
from hardware_bridge.recording.bag_on_disk import file_of, journals_in
from hardware_bridge.recording.journal_repair import mend
from hardware_bridge.recording.message_definitions import ShareSchemas
from hardware_bridge.recording.recorder import Recorder

PACKAGES = ("tensegrity_robot", "hardware_bridge", "sim_core", "numpy", "numba", "mcap", "pyserial")
MOST_EARLY = 1000
YEAR_2020_S = 1_577_836_800
YOUNG_S = 1.0
"""A journal younger than this may belong to a session that has not locked it yet."""


def bag_folder(configured: str) -> Path:
    """Where bags go: as configured, else `$SIXSTRUT_BAGS`, else `bags` below the working directory."""
    return Path(configured or os.environ.get("SIXSTRUT_BAGS") or "bags").expanduser().resolve()


def make_bag(folder: Path, now: time.struct_time) -> Path:
    """A new folder `session_<UTC>` for one bag, with a number where that exists. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = time.strftime("session_%Y%m%d_%H%M%S", now)
    for number in range(1, 1000):
        bag = folder / (stem if number == 1 else f"{stem}_{number}")
        if not any(bag.with_name(bag.name + suffix).exists() for suffix in (".mcap", ".mcap.journal")):  # of an older bridge
            with suppress(FileExistsError):
                bag.mkdir()
                return bag
    raise FileExistsError(f"{folder} is full of sessions of this second")


def versions() -> dict[str, str]:
    """Versions of what made the session; packages that are not installed as such are left out."""
    found = {"python": platform.python_version(), "machine": platform.machine(), "ros_distro": os.environ.get("ROS_DISTRO", "")}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def mend_journals(folder: Path) -> list[str]:
    """Make bags of the journals that dead sessions left in a folder; one line for people each.

    A living session's journal is locked, or was made a moment ago. Waits for the latter to become one or the other.
    """
    return [line for journal in journals_in(folder) if (line := _mend(journal))]


def _mend(journal: Path) -> str:
    path = journal.with_suffix("")
    try:
        with journal.open("rb") as owner:
            age_s = time.time() - journal.stat().st_mtime  # by clocks that somebody may have set in between
            time.sleep(min(YOUNG_S, max(0.0, YOUNG_S - age_s)))
            fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists():
                return f"{journal} is left over beside a finished {path.name}: remove it"
            return mend(journal, path)
    except (BlockingIOError, FileNotFoundError):
        return ""
    except (BridgeError, OSError) as error:
        return f"could not mend {journal}: {error}"


class SessionLog:
    """One bag. Messages written before `open` wait for it; a failed log never fails the caller, but says so.

    Attributes:
        path: of the bag, a folder; None before `open`.
        began_ns: log time of its first message; 0 before that.
        fault: why the log is dead; empty if it is well.
    """

    def __init__(self, on_fault: Callable[[str], None]):
        """Args: on_fault: told once, from any thread, that the log is dead and why."""
        self.path: Path | None = None
        self.began_ns = 0
        self._on_fault = on_fault
        self._recorder: Recorder | None = None
        self._owner: IO[bytes] | None = None
        self._early: list[tuple[str, str, bytes, int]] = []
        self._lock = threading.Lock()
        self.fault = ""

    @property
    def messages(self) -> int:
        """Messages that are safe with the operating system."""
        return self._recorder.messages_written if self._recorder else 0

    @property
    def waiting(self) -> int:
        """Messages that wait for the disk now."""
        return self._recorder.waiting if self._recorder else 0

    @property
    def most_waiting(self) -> int:
        """Largest number of messages that ever waited for the disk."""
        return self._recorder.most_waiting if self._recorder else 0

    def open(
        self, folder: Path, topics: Mapping[str, tuple[str, bool]], attachments: Mapping[str, bytes], facts: Mapping[str, str]
    ) -> None:
        """Begin the bag.

        Args:
            folder: where the bag's own folder is made.
            topics: name -> (type, transient_local).
            attachments: name -> bytes.
            facts: kept as metadata "session", beside "versions".

        Raises:
            BridgeError, OSError: it cannot be written, or the computer does not know what day it is.
        """
        if time.time() < YEAR_2020_S:
            day = time.strftime("%Y-%m-%d", time.gmtime())
            problem = f"not begun, the computer's clock says {day}: set it (timedatectl), or do without a log (record:=false)"
            raise RecorderError(str(folder), problem)
        try:
            bag = make_bag(folder, time.gmtime())
        except OSError as error:
            problem = f"cannot be made ({error.strerror}); give another bag_folder, or do without a log (record:=false)"
            raise RecorderError(str(folder), problem) from error
        schemas = ShareSchemas()
        recorder = Recorder(file_of(bag), schemas.schema_text, type_hash=schemas.type_hash, on_fault=self._fail)
        self._owner = recorder.journal.open("rb")  # its lock says that the session lives, see mend_journals
        fcntl.flock(self._owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            recorder.add_metadata("versions", versions())
            recorder.add_metadata("session", facts)
            for name, data in attachments.items():
                recorder.add_attachment(name, data)
            for topic, (type_name, transient_local) in topics.items():
                recorder.add_topic(topic, type_name, transient_local=transient_local)
        except BridgeError:
            recorder.close()
            raise
        with self._lock:
            self._recorder, self.path = recorder, bag
            early, self._early = self._early, []
            for message in early:
                self._write(*message)

    def write(self, topic: str, type_name: str, data: bytes, log_time_ns: int) -> None:
        """Log one serialised message; before `open` it waits, after `close` it is dropped."""
        with self._lock:
            if self._recorder is not None:
                self._write(topic, type_name, data, log_time_ns)
            elif self.path is None and len(self._early) < MOST_EARLY:
                self._early.append((topic, type_name, data, log_time_ns))

    def _write(self, topic: str, type_name: str, data: bytes, log_time_ns: int) -> None:
        assert self._recorder is not None
        try:
            self._recorder.write(topic, type_name, data, log_time_ns)
            self.began_ns = self.began_ns or log_time_ns
        except BridgeError as error:
            self._fail(str(error))

    def sync(self) -> None:
        """Wait until all that was written is on the disk itself. Raises BridgeError: it is not, or there is no bag."""
        recorder = self._recorder
        if recorder is None:
            raise RecorderError(str(self.path), "is not open")
        recorder.sync()

    def _fail(self, problem: str) -> None:
        if not self.fault:
            self.fault = problem
            self._on_fault(problem)

    def close(self) -> None:
        """Finish the bag. Raises BridgeError: it cannot be finished; what was written stays beside it."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        try:
            if recorder is not None:
                recorder.close()
        finally:
            if self._owner is not None:
                self._owner.close()
