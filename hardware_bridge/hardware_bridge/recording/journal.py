# SPDX-License-Identifier: Apache-2.0
"""From a journal, safe against crashes, to a log, good for readers.

While a session lives, messages go unchunked into `<name>.mcap.journal` and each is flushed. After each record comes another one,
of a kind that other readers skip: the record's length and checksum behind a mark that nothing else has. At the session's end the
journal is rewritten chunked, compressed and indexed as `<name>.mcap`, read again and compared, and only then dropped; in a folder
`<name>` of its own it gets rosbag2's `metadata.yaml`. The same function finishes the journal of a session that was killed: damage
costs the damaged place only, what follows it is found by the marks, and a journal of which more than a cut tail could not be read
is kept. Journals of old have no marks; in them the next record is found by what a record of that session can look like.
"""

import hashlib
import mmap
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer

from hardware_bridge.errors import RecorderError
from hardware_bridge.recording.bag_on_disk import write_metadata
from hardware_bridge.recording.bag_reader import FRAME, MAGIC, MESSAGE_HEAD

PROFILE = "ros2"
LIBRARY = "sixstrut"
RECOVERY = "recovery"
"""Metadata of a log that was made of what a killed session left."""
DAMAGED = ".damaged"

_CHECK = struct.Struct("<16sII")
_CHECK_OPCODE = 0x80
"""The first that MCAP leaves to applications; its readers skip what they do not know."""
_MARK = b"sixstrut\xf1\x9d\x00\xe6\x7b\x8a\xff\x15"
_SIGNATURE = FRAME.pack(_CHECK_OPCODE, _CHECK.size) + _MARK
_CHECK_SIZE = FRAME.size + _CHECK.size
_KNOWN: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
}
_DAY_NS = 86_400_000_000_000


class Checked:
    """A journal's stream for a `Writer`: after each record, `seal` writes its check."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._length = self._crc = 0

    def write(self, data: bytes) -> int:
        """As a file's."""
        self._crc = zlib.crc32(data, self._crc)
        self._length += len(data)
        return self._stream.write(data)

    def tell(self) -> int:
        """As a file's."""
        return self._stream.tell()

    def flush(self) -> None:
        """As a file's."""
        self._stream.flush()

    def write_records(self, records: Iterable[McapRecord]) -> None:
        """Whole records."""
        for record in records:
            builder = RecordBuilder()
            record.write(builder)
            self.write(builder.end())

    def seal(self) -> None:
        """Ends what was written since the last time."""
        if self._length:
            body = _CHECK.pack(_MARK, self._length, self._crc)
            self._stream.write(FRAME.pack(_CHECK_OPCODE, len(body)) + body)
        self._length = self._crc = 0


@dataclass(kw_only=True)
class Found:
    """What a journal turned out to be.

    Attributes:
        complete: it has its proper end; else the session was killed and the log holds what was acknowledged.
        checked: it has checksums.
        unread_bytes, unread_places: what could not be read; a tail that was cut does not count.
        missing: messages that are missing there, by their numbers.
    """

    complete: bool = False
    checked: bool = False
    unread_bytes: int = 0
    unread_places: int = 0
    missing: int = 0

    def skip(self, size: int) -> None:
        """Some bytes could not be read."""
        self.unread_bytes += size
        self.unread_places += 1


@dataclass(kw_only=True)
class Recording(Found):
    """A finished log, made of a journal.

    Attributes:
        path: the file.
        counts: messages of each topic.
        kept: where the journal is kept, if something was unread.
    """

    path: Path
    counts: Counter[str]
    kept: Path | None

    @property
    def messages(self) -> int:
        """How many it has."""
        return self.counts.total()


@dataclass
class _Tally:
    """What went through: enough to compare two files by."""

    counts: Counter[str] = field(default_factory=Counter)
    others: int = 0
    digest: "hashlib._Hash" = field(default_factory=hashlib.sha256)

    def add_message(self, topic: str, message: Message) -> None:
        self.counts[topic] += 1
        head = struct.pack("<IQQ", message.sequence, message.log_time, message.publish_time)
        self.digest.update(topic.encode() + head + message.data)

    @property
    def value(self) -> tuple[dict[str, int], int, str]:
        return self.counts, self.others, self.digest.hexdigest()


def finish_journal(journal: Path, path: Path) -> Recording:
    """Rewrites `journal` as `path`, verifies it, makes it durable and removes the journal, or keeps it if it is damaged.

    Raises:
        RecorderError: it cannot be written, or does not read back as the journal does; the journal stays.
    """
    temporary = path.with_name(path.name + ".tmp")
    try:
        source, found = _rewrite(journal, temporary)
        copy, summary = _tally(temporary), _summary(temporary)
        indexed = summary.statistics.message_count if summary is not None and summary.statistics is not None else -1
        if summary is None or copy.value != source.value or indexed != source.counts.total():
            raise RecorderError(str(path), f"does not read back as written; the journal {journal} is kept")
        write_metadata(path, summary)
        temporary.replace(path)
        kept = _keep(journal) if found.unread_places else None
        if kept is None:
            journal.unlink()
        _sync_directory(path.parent)
    except OSError as error:
        problem = f"cannot be finished ({error.strerror}); the journal {journal} is kept, free space and finish it again"
        raise RecorderError(str(path), problem) from error
    finally:
        temporary.unlink(missing_ok=True)
    return Recording(path=path, counts=source.counts, kept=kept, **vars(found))


def _keep(journal: Path) -> Path:
    number = 1
    while (kept := journal.with_name(f"{journal.name}{DAMAGED}{number if number > 1 else ''}")).exists():
        number += 1
    journal.replace(kept)
    return kept


def _rewrite(journal: Path, target: Path) -> tuple[_Tally, Found]:
    tally, found = _Tally(), Found()
    declared = _declared(journal)
    channels: dict[int, tuple[int, str]] = {}
    newest: dict[int, int] = {}
    with target.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(PROFILE, LIBRARY)
        for number, (channel, schema) in declared.items():
            kind = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
            own = writer.register_channel(channel.topic, channel.message_encoding, kind, channel.metadata)
            channels[number] = own, channel.topic
        for record, size in _records(journal, found):
            match record:
                case Schema() | Channel():
                    pass
                case Message() if record.channel_id in channels:
                    number, topic = channels[record.channel_id]
                    writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
                    tally.add_message(topic, record)
                    found.missing += max(0, record.sequence - newest.get(record.channel_id, record.sequence - 1) - 1)
                    newest[record.channel_id] = record.sequence
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
                    tally.others += 1
                case Attachment():
                    times = record.create_time, record.log_time
                    writer.add_attachment(*times, record.name, record.media_type, record.data)
                    tally.others += 1
                case _:  # of a channel or type that it does not declare, or whose declaration was damaged
                    found.skip(size)
        if found.unread_places:
            facts = {
                "unread_bytes": found.unread_bytes,
                "unread_places": found.unread_places,
                "missing_messages": found.missing,
                "checked": str(found.checked).lower(),
                "journal": journal.name + DAMAGED,
            }
            writer.add_metadata(RECOVERY, {name: str(value) for name, value in facts.items()})
            tally.others += 1
        writer.finish()
        stream.flush()
        os.fsync(stream.fileno())
    return tally, found


def _declared(journal: Path) -> dict[int, tuple[Channel, Schema | None]]:
    """Every channel with its schema, wherever in the journal it is declared: the recorder does so again and again."""
    schemas: dict[int, Schema | None] = {0: None}
    channels: dict[int, Channel] = {}
    for record, _ in _records(journal, Found(), (Opcode.SCHEMA, Opcode.CHANNEL)):
        if isinstance(record, Schema):
            schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            channels.setdefault(record.id, record)
    return {number: (channel, schemas[channel.schema_id]) for number, channel in channels.items() if channel.schema_id in schemas}


def _records(path: Path, found: Found, kinds: Collection[int] = tuple(_KNOWN)) -> Iterator[tuple[McapRecord | None, int]]:
    """Every record of these kinds, with its size; None for one that makes no sense. `found` says what could not be read."""
    with path.open("rb") as stream:
        if os.fstat(stream.fileno()).st_size == 0:
            raise RecorderError(str(path), "is no MCAP file")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            found.checked = data.find(_SIGNATURE) >= 0  # else its first bytes must be well
            if not found.checked and not (len(data) >= len(MAGIC) + FRAME.size and data[:9] == MAGIC + bytes([Opcode.HEADER])):
                raise RecorderError(str(path), "is no MCAP file")
            for start, end in (_checked_spans if found.checked else _unchecked_spans)(data, found):
                yield from _parsed(data, start, end, kinds)


def _checked_spans(data: mmap.mmap, found: Found) -> Iterator[tuple[int, int]]:
    """Spans of whole records whose checksums fit. After the last check, what was not acknowledged any more: a tail."""
    done = 0
    at = data.find(_SIGNATURE)
    while at >= 0 and at + _CHECK_SIZE <= len(data):
        _, length, crc = _CHECK.unpack_from(data, at + FRAME.size)
        start = at - length
        if start >= done and _crc(data, start, at) == crc:
            if start > done:
                found.skip(start - done)
            yield max(start, len(MAGIC)), at
            done = at + _CHECK_SIZE
        at = data.find(_SIGNATURE, max(done, at + 1))
    yield from _unchecked_spans(data, found, done)


def _crc(data: mmap.mmap, start: int, end: int) -> int:
    with memoryview(data) as view, view[start:end] as span:
        return zlib.crc32(span)


def _unchecked_spans(data: mmap.mmap, found: Found, at: int = len(MAGIC)) -> Iterator[tuple[int, int]]:
    """Spans of records as they follow each other, each believed only if what follows can be one; else the next is sought."""
    looks = _Looks(data)
    while at < len(data):
        end = looks.end(at)
        if end is not None and data[at] == Opcode.DATA_END:
            found.complete = True
            return
        if end is not None and looks.followed(at, end):
            looks.learn(at)
            yield at, end
            at = end
            continue
        following = looks.next(at + 1)
        if following is None:
            if not looks.cut(at):
                found.skip(len(data) - at)
            return
        found.skip(following - at)
        at = following


@dataclass
class _Looks:
    """What a record of this journal can look like: judged by those before it."""

    data: mmap.mmap
    channels: set[int] = field(default_factory=set)
    log_time: int | None = None
    _pattern: re.Pattern[bytes] | None = None

    def end(self, at: int) -> int | None:
        """Where the record that begins here ends; None: none that is whole begins here."""
        end = self._said_end(at)
        return None if end is None or end > len(self.data) else end

    def cut(self, at: int) -> bool:
        """Whether a record begins here whose end is not there any more, or part of its first bytes."""
        left = len(self.data) - at
        if left < FRAME.size + MESSAGE_HEAD.size:
            return left == 0 or self.data[at] in (*_KNOWN, Opcode.DATA_END, _CHECK_OPCODE)
        end = self._said_end(at)
        return end is not None and end > len(self.data)

    def _said_end(self, at: int) -> int | None:
        """Where the record that begins here ends by its own word; None: it looks like none."""
        body = at + FRAME.size
        if body > len(self.data):
            return None
        opcode, length = FRAME.unpack_from(self.data, at)
        likely = length < 1 << 32
        if opcode == _CHECK_OPCODE:
            likely = length == _CHECK.size and _MARK.startswith(self.data[body : body + len(_MARK)])
        elif opcode != Opcode.MESSAGE:
            likely &= opcode in (Opcode.HEADER, Opcode.DATA_END, *_KNOWN)
        elif length < MESSAGE_HEAD.size or body + MESSAGE_HEAD.size > len(self.data):
            return None
        else:
            channel, _, log_time, _ = MESSAGE_HEAD.unpack_from(self.data, body)
            if self.log_time is None:
                likely &= channel in self.channels or not self.channels
            else:
                likely &= abs(log_time - self.log_time) < _DAY_NS
        return body + length if likely else None

    def followed(self, at: int, end: int) -> bool:
        """Whether what comes after a record can be one, or the end, a cut one, or a hole."""
        known = set(self.channels)
        if self.data[at] == Opcode.CHANNEL:  # what follows may be of that channel
            self.channels.add(self._channel(at))
        after, before = self.data[end : end + FRAME.size], self.data[max(at, end - FRAME.size) : end]
        hole = not any(after) and (any(before) or not after)  # as a power cut leaves it, not within the record; or the end
        follows = hole or self.end(end) is not None or self.cut(end)
        self.channels = known
        return follows

    def _channel(self, at: int) -> int:
        return int(struct.unpack_from("<H", self.data, at + FRAME.size)[0]) if at + FRAME.size + 2 <= len(self.data) else -1

    def learn(self, at: int) -> None:
        """A record that is believed."""
        opcode, _ = FRAME.unpack_from(self.data, at)
        if opcode == Opcode.CHANNEL:
            self.channels.add(self._channel(at))
            self._pattern = None
        elif opcode == Opcode.MESSAGE:
            self.log_time = MESSAGE_HEAD.unpack_from(self.data, at + FRAME.size)[2]

    def next(self, at: int) -> int | None:
        """Where the next record begins that can be one and is followed by another, by the end, or by a cut one."""
        if self._pattern is None:  # a known kind, a length below 4 GB, for a message a known channel
            numbers = b"|".join(re.escape(struct.pack("<H", channel)) for channel in sorted(self.channels) if channel >= 0) or b".."
            kinds = (
                b"[" + re.escape(bytes([Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END])) + b"]"
            )
            self._pattern = re.compile(b"\\x05.{4}\\x00{4}(?:" + numbers + b")|" + kinds + b".{4}\\x00{4}", re.DOTALL)
        while (match := self._pattern.search(self.data, at)) is not None:
            start = match.start()
            end = self.end(start)
            if end is not None and end > start + FRAME.size and self.followed(start, end):
                return start
            at = start + 1
        return None


def _parsed(data: mmap.mmap, start: int, end: int, kinds: Collection[int]) -> Iterator[tuple[McapRecord | None, int]]:
    """The records of a span; one that makes no sense is None."""
    while start + FRAME.size <= end:
        opcode, length = FRAME.unpack_from(data, start)
        start += FRAME.size
        if length > end - start:
            yield None, end - start + FRAME.size
            return
        if opcode in kinds:
            fields = ReadDataStream(BytesIO(data[start : start + length]))
            try:
                record = Message.read(fields, length) if opcode == Opcode.MESSAGE else _KNOWN[opcode].read(fields)
            except (McapError, struct.error, ValueError, EOFError):
                record = None
            yield record, length + FRAME.size
        elif opcode not in (Opcode.HEADER, _CHECK_OPCODE, *_KNOWN):
            yield None, length + FRAME.size
        start += length


def _tally(path: Path) -> _Tally:
    """Of a log that was just written. Raises RecorderError: it does not read back."""
    tally = _Tally()
    topics: dict[int, str] = {}
    try:
        with path.open("rb") as stream:
            for record in StreamReader(stream, validate_crcs=True).records:
                match record:
                    case Channel():
                        topics[record.id] = record.topic
                    case Message():
                        tally.add_message(topics[record.channel_id], record)
                    case Metadata() | Attachment():
                        tally.others += 1
    except (McapError, struct.error, ValueError, EOFError, KeyError) as error:
        raise RecorderError(str(path), f"does not read back ({error}); the journal is kept") from error
    return tally


def _summary(path: Path) -> Summary | None:
    with path.open("rb") as stream:
        return make_reader(stream).get_summary()


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
