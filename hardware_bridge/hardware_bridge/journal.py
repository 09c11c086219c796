"""From a journal, safe against crashes, to a log, good for readers.

While a session lives, messages go unchunked into ``<name>.mcap.journal`` and each is flushed. At its end the journal is
rewritten chunked, compressed and indexed as ``<name>.mcap``, read again and compared, and only then dropped. The same
function finishes the journal of a session that was killed, up to the last whole record.
"""

from __future__ import annotations

import hashlib
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from hardware_bridge.errors import RecorderError

PROFILE = "ros2"
LIBRARY = "sixstrut"


@dataclass(frozen=True)
class Recording:
    """A finished log.

    Attributes:
        path: The file.
        messages: How many it has.
        counts: Messages of each topic.
        complete: The journal had its proper end; else the session was killed and the log holds what was acknowledged.
    """

    path: Path
    messages: int
    counts: dict[str, int]
    complete: bool


@dataclass
class _Tally:
    """What went through: enough to compare two files by."""

    counts: dict[str, int]
    others: int
    digest: hashlib._Hash

    @classmethod
    def empty(cls) -> _Tally:
        return cls({}, 0, hashlib.sha256())

    def add_message(self, topic: str, message: Message) -> None:
        self.counts[topic] = self.counts.get(topic, 0) + 1
        head = struct.pack("<IQQ", message.sequence, message.log_time, message.publish_time)
        self.digest.update(topic.encode() + head + message.data)

    @property
    def value(self) -> tuple[dict[str, int], int, str]:
        return self.counts, self.others, self.digest.hexdigest()


def finish_journal(journal: Path, path: Path) -> Recording:
    """Rewrites ``journal`` as ``path``, verifies it, makes it durable and removes the journal.

    Raises:
        RecorderError: It cannot be written, or does not read back as the journal does; the journal stays.
    """
    temporary = path.with_name(path.name + ".tmp")
    try:
        source, complete = _rewrite(journal, temporary)
        copy, whole = _tally(temporary)
        if copy.value != source.value or not whole or _indexed_messages(temporary) != sum(source.counts.values()):
            raise RecorderError(str(path), f"does not read back as written; the journal {journal} is kept")
        os.replace(temporary, path)
        _sync_directory(path.parent)
        journal.unlink()
    except OSError as error:
        problem = f"cannot be finished ({error.strerror}); the journal {journal} is kept, free space and finish it again"
        raise RecorderError(str(path), problem) from error
    finally:
        temporary.unlink(missing_ok=True)
    return Recording(path, sum(source.counts.values()), source.counts, complete)


def _rewrite(journal: Path, target: Path) -> tuple[_Tally, bool]:
    tally = _Tally.empty()
    end = _End()
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, tuple[int, str]] = {}
    with target.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(PROFILE, LIBRARY)
        for record in _records(journal, end):
            match record:
                case Schema() if record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                case Channel() if record.id not in channels:
                    schema = schemas[record.schema_id]
                    number = writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
                    channels[record.id] = number, record.topic
                case Message():
                    number, topic = channels[record.channel_id]
                    writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
                    tally.add_message(topic, record)
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
                    tally.others += 1
                case Attachment():
                    times = record.create_time, record.log_time
                    writer.add_attachment(*times, record.name, record.media_type, record.data)
                    tally.others += 1
        writer.finish()
        stream.flush()
        os.fsync(stream.fileno())
    return tally, end.reached


def _tally(path: Path) -> tuple[_Tally, bool]:
    tally = _Tally.empty()
    end = _End()
    topics: dict[int, str] = {}
    for record in _records(path, end):
        match record:
            case Channel():
                topics[record.id] = record.topic
            case Message():
                tally.add_message(topics[record.channel_id], record)
            case Metadata() | Attachment():
                tally.others += 1
    return tally, end.reached


class _End:
    reached = False


def _records(path: Path, end: _End) -> Iterator[McapRecord]:
    """Every whole record, chunks opened; a cut tail ends it quietly, with ``end`` not reached."""
    with path.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        first = True
        while True:
            try:
                record = next(records)
            except StopIteration:
                end.reached = True
                return
            except (McapError, struct.error, ValueError, EOFError):
                if first:
                    raise RecorderError(str(path), "is no MCAP file") from None
                return
            if first and not isinstance(record, Header):
                raise RecorderError(str(path), "is no MCAP file")
            first = False
            yield record


def _indexed_messages(path: Path) -> int:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        return -1
    return int(summary.statistics.message_count)


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
