# SPDX-License-Identifier: Apache-2.0
"""The session's log: one MCAP file that rosbag2, rosbags, Foxglove and PlotJuggler read without our workspace.

Recorded topics get names under `/recorded/`, to which no live node listens: playing the log moves nothing.
"""

import contextlib
import logging
import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

from mcap.records import Channel, Schema
from mcap.writer import IndexType, Writer

from hardware_bridge.errors import RecorderError
from hardware_bridge.recording.journal import LIBRARY, PROFILE, Checked, Recording, finish_journal

_log = logging.getLogger(__name__)

PREFIX = "/recorded/"
DECLARED_FIRST, DECLARED_EVERY = 100, 5000
"""After so many messages the journal says again which topics it has."""
_FOREVER = "{sec: 9223372036, nsec: 854775807}"


def recorded_topic(topic: str) -> str:
    """The name under which `topic` is recorded."""
    return PREFIX + topic.strip("/")


def _offered_qos(transient_local: bool) -> str:
    """A reliable publisher's quality of service as rosbag2 of Jazzy writes it, in YAML."""
    durability = "transient_local" if transient_local else "volatile"
    return (
        f"- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: {durability}\n"
        f"  deadline: {_FOREVER}\n  lifespan: {_FOREVER}\n  liveliness: automatic\n"
        f"  liveliness_lease_duration: {_FOREVER}\n  avoid_ros_namespace_conventions: false\n"
    )


class _Item(NamedTuple):
    """What waits for the disk: how it is written, whether it is a message, and who is told when it was its turn."""

    write: Callable[[], None]
    is_message: bool = False
    done: threading.Event | None = None


class Recorder:
    """Writes a log from any thread without ever waiting for the disk.

    A bounded queue feeds one writing thread. If the queue is full or the disk fails, that is a fault: it is latched,
    counted, told to `on_fault` once, and every later `write` raises. Nothing is dropped silently.

    Args:
        path: the log, `….mcap`; while it lives, `<path>.journal` grows instead.
        schema_text: gives the whole definition of `package/msg/Name`; see `ShareSchemas`.
        type_hash: gives a type's RIHS01 hash, or an empty string.
        queue_size: messages that may wait for the disk.
        on_fault: told the first fault, once, from the thread that met it.

    Attributes:
        path: the log.
        journal: the growing file.
        fault: what went wrong first; empty if nothing did.
        messages_written: messages handed to the operating system: these survive the death of the process.
        messages_lost: messages that a fault kept out of the log.
        most_waiting: largest number of entries that ever waited.

    Raises:
        RecorderError: the file exists already, or the folder cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        schema_text: Callable[[str], str],
        *,
        type_hash: Callable[[str], str] = lambda type_name: "",
        queue_size: int = 20_000,
        on_fault: Callable[[str], None] = lambda problem: None,
    ) -> None:
        self.path = Path(path)
        self.journal = self.path.with_name(self.path.name + ".journal")
        self._schema_text = schema_text
        self._type_hash = type_hash
        self._on_fault = on_fault
        self._queue: queue.Queue[_Item | None] = queue.Queue(queue_size)
        self._lock = threading.RLock()
        self._types: dict[str, str] = {}
        self._channels: dict[str, int] = {}  # this and the next two are the writing thread's
        self._sequences: Counter[str] = Counter()
        self._declared: list[Schema | Channel] = []
        self.fault = ""
        self.messages_written = self.messages_lost = self.most_waiting = 0
        self._recording: Recording | None = None
        self._closed = False
        if self.path.exists():
            raise RecorderError(str(self.path), "exists; choose another name, a log is never overwritten")
        try:
            self._stream = self.journal.open("xb")
        except FileExistsError:
            problem = f"its journal {self.journal} exists; finish that session first or choose another name"
            raise RecorderError(str(self.path), problem) from None
        except OSError as error:
            raise RecorderError(str(self.path), f"cannot be written ({error.strerror}); choose another folder") from error
        self._checked = Checked(self._stream)
        self._writer = Writer(cast(Any, self._checked), use_chunking=False, index_types=IndexType.NONE)
        self._writer.start(PROFILE, LIBRARY)
        self._checked.seal()
        self._stream.flush()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Entries that wait for the disk now; `queue_size` of them is a fault."""
        return self._queue.qsize()

    # ---- writing ----------------------------------------------------------------------------------------------------

    def add_topic(self, topic: str, type_name: str, transient_local: bool = False) -> None:
        """Declares a topic with its publisher's durability; without it, the first `write` does, as volatile.

        Raises:
            RecorderError: the topic has another type already, or a fault is latched.
            SchemaError: the type is not installed.
        """
        with self._lock:
            known = self._types.get(topic)
            if known == type_name:
                return
            if known is not None:
                raise RecorderError(str(self.path), f"topic {topic} is {known}, it cannot also be {type_name}")
            metadata = {"offered_qos_profiles": _offered_qos(transient_local)}
            if type_hash := self._type_hash(type_name):
                metadata["topic_type_hash"] = type_hash
            text = self._schema_text(type_name).encode()
            self._put(_Item(lambda: self._declare(recorded_topic(topic), type_name, text, metadata)))
            self._types[topic] = type_name

    def write(self, topic: str, type_name: str, data: bytes, log_time_ns: int) -> None:
        """Queues one serialised message; returns at once.

        Args:
            topic: as live; it is recorded under `/recorded/`.
            type_name: `package/msg/Name`.
            data: CDR, as `serialize_message` gives it.
            log_time_ns: ROS time of receipt or sending, in [ns].

        Raises:
            RecorderError: a fault is latched, the queue is full, or the log is closed: the message is counted as lost.
            SchemaError: the type is not installed.
        """
        if self._types.get(topic) != type_name:
            self.add_topic(topic, type_name)
        self._put(_Item(lambda: self._write_message(recorded_topic(topic), data, log_time_ns), is_message=True))

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Queues named strings: versions, hashes, parameters. Raises `RecorderError` as `write`."""
        kept = dict(data)
        self._put(_Item(lambda: self._writer.add_metadata(name, kept)))

    def add_attachment(self, name: str, data: bytes) -> None:
        """Queues a whole file: configuration, calibration, library. Raises `RecorderError` as `write`."""
        now_ns = time.time_ns()
        self._put(_Item(lambda: self._writer.add_attachment(now_ns, now_ns, name, "text/plain", data)))

    def sync(self, timeout_s: float = 10.0) -> None:
        """Waits until all that was queued before is on the disk itself, not only with the operating system.

        Raises:
            RecorderError: a fault is latched, or it takes longer.
        """
        done = threading.Event()
        self._put(_Item(self._sync, done=done))
        if not done.wait(timeout_s):
            raise RecorderError(str(self.path), f"the disk did not take it in {timeout_s:g} s; check disk and load")
        self._raise_fault()

    def close(self) -> Recording:
        """Writes everything queued, finishes the journal, and rewrites, verifies and syncs the log. Twice is fine.

        Raises:
            RecorderError: the log cannot be finished; what was written stays in the journal.
        """
        with self._lock:
            first, self._closed = not self._closed, True
        if first:
            self._queue.put(None)
        self._thread.join()
        if self._recording is None:
            self._recording = finish_journal(self.journal, self.path)
        return self._recording

    # ---- the queue --------------------------------------------------------------------------------------------------

    def _put(self, item: _Item) -> None:
        with self._lock:
            try:
                self._raise_fault()
                if self._closed:
                    raise RecorderError(str(self.path), "is closed")
                try:
                    self._queue.put_nowait(item)
                    self.most_waiting = max(self.most_waiting, self._queue.qsize())
                except queue.Full:
                    self._fail(f"more than {self._queue.maxsize} messages wait for the disk; check disk and load")
                    self._raise_fault()
            except RecorderError:
                self._count_lost(item)
                raise

    def _count_lost(self, item: _Item) -> None:
        with self._lock:
            self.messages_lost += item.is_message

    def _raise_fault(self) -> None:
        if self.fault:
            raise RecorderError(str(self.path), self.fault)

    def _fail(self, problem: str) -> None:
        if self.fault:
            return
        self.fault = problem
        try:
            self._on_fault(problem)
        except Exception:
            _log.exception("callback of the recorder")

    # ---- the writing thread -----------------------------------------------------------------------------------------

    def _run(self) -> None:
        broken = False
        while (item := self._queue.get()) is not None:
            try:
                if not broken:
                    self._write_item(item)
            except Exception as error:
                broken = True
                reason = getattr(error, "strerror", None) or str(error)
                self._fail(f"writing failed ({reason}); free space or check the disk")
            if broken:
                self._count_lost(item)
            if item.done is not None:
                item.done.set()
        try:
            if not broken:
                self._writer.finish()
            self._sync()
        except Exception as error:
            self._fail(f"finishing the journal failed ({error})")
        finally:
            with contextlib.suppress(OSError):  # told above already
                self._stream.close()

    def _write_item(self, item: _Item) -> None:
        item.write()
        self._checked.seal()
        self._stream.flush()
        if item.is_message:
            self.messages_written += 1
            if self.messages_written == DECLARED_FIRST or self.messages_written % DECLARED_EVERY == 0:
                # again, so that damage at one place takes no topic away
                self._checked.write_records(self._declared)
                self._checked.seal()

    def _declare(self, name: str, type_name: str, text: bytes, metadata: dict[str, str]) -> None:
        schema = self._writer.register_schema(type_name, "ros2msg", text)
        number = self._channels[name] = self._writer.register_channel(name, "cdr", schema, metadata)
        self._declared.append(Schema(id=schema, name=type_name, encoding="ros2msg", data=text))
        self._declared.append(Channel(number, name, "cdr", metadata, schema))

    def _write_message(self, name: str, data: bytes, log_time_ns: int) -> None:
        self._sequences[name] += 1
        self._writer.add_message(self._channels[name], log_time_ns, data, log_time_ns, self._sequences[name])

    def _sync(self) -> None:
        self._stream.flush()
        os.fsync(self._stream.fileno())
