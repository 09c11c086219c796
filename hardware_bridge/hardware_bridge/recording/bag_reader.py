# SPDX-License-Identifier: Apache-2.0
"""The one opener of bags, with no ROS installed: what was sent, what was seen, what the twin said.

A bag comes from anywhere. So it is read once from its beginning to its end, checksums on, and nothing that it says about itself is
believed before it is bounded: records by the file's size, chunks by what they say they unpack to and by what they do, all of them
together by the file's size, messages by their number. Only the topics that are wanted are decoded, and those of ours only if they
have the fields that are read.
"""

import os
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_on_disk import AT_ITS_END, CONVERT, files_of, is_bag_folder
from hardware_bridge.recording.bag_types import misfit_of
from sim_core.printable import printable

MAGIC = b"\x89MCAP0\r\n"
FRAME = struct.Struct("<BQ")
"""What a record begins with: its kind and its length."""
MESSAGE_HEAD = struct.Struct("<HIQQ")
"""What a message begins with: channel, number, log time and publish time."""
MOST_RECORD = 256 << 20
MOST_CHUNK = 64 << 20
"""Unpacked. Writers cut chunks at about 1 MB; one large message makes a larger one."""
MOST_RATIO = 1000
"""All chunks together may unpack to so many times the file, and FREE more."""
FREE = 256 << 20
FREE_RECORDS = 1_000_000
"""Beside one for each byte of the file."""
MOST_MESSAGES = 4_000_000
MOST_WANTED = 1 << 30
"""Bytes of the messages that are wanted, before they are decoded; nor more than FREE and 100 times the file."""
MOST_ATTACHED = 64 << 20
MOST_CHANNELS = 10_000

_TOO_LARGE = "is too large to be read at once"
_COPY = "copy it again from where it was recorded"


class Recorded(NamedTuple):
    """One message of a bag: its topic, when it was logged (ns, ROS time) and its decoded fields."""

    topic: str
    log_time_ns: int
    message: Any


class Raw(NamedTuple):
    """One message as it lies in a bag: topic without the recording prefix, type, definition, how both are encoded, bytes."""

    topic: str
    type_name: str
    definition: str
    encoding: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class Session:
    """A bag in memory.

    Attributes:
        path: the file, or rosbag2's folder.
        messages: topic without the recording prefix and namespace's leading slash ("bridge/struts_sent") -> messages in log order.
        attachments: name -> bytes.
        metadata: name -> mapping of strings.
    """

    path: Path
    messages: dict[str, list[Recorded]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

    def recorded(self, topic: str) -> Iterator[Recorded]:
        """Messages of a topic, such as "bridge/struts_sent", whatever namespace it was recorded in."""
        for name, messages in self.messages.items():
            if name == topic or name.endswith("/" + topic):
                yield from messages

    def require(self, *topics: str) -> None:
        """Raises BagError: a bag that is not the bridge's, so that it holds what somebody chose, has no message of one of them."""
        missing = [topic for topic in topics if next(self.recorded(topic), None) is None]
        if missing and "session" not in self.metadata:
            raise BagError(f"{self.path} holds no message of topic {missing[0]}: record it too, or give a bag of the bridge")

    def of(self, topic: str) -> Iterator[Any]:
        """Decoded messages of a topic, as `recorded`."""
        return (recorded.message for recorded in self.recorded(topic))


@dataclass
class Bag:
    """A bag as it lies in the file: see `Session`; messages in log order, not decoded."""

    path: Path
    messages: list[Raw] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

    def session(self, since_ns: int = 0, until_ns: int = 1 << 64, required: bool = True) -> Session:
        """What was logged within a span, decoded. `required`: a topic that cannot be decoded is an error. Raises BagError."""
        session = Session(self.path, attachments=self.attachments, metadata=self.metadata)
        decoders: dict[tuple[Any, ...], Callable[[bytes], Any] | None] = {}
        for message in self.messages:
            if since_ns <= message.log_time_ns < until_ns:
                kind = message[:4]
                if kind not in decoders:
                    decoders[kind] = _decoder(self.path, message, required)
                decode = decoders[kind]
                if decode is not None:
                    recorded = Recorded(message.topic, message.log_time_ns, _decoded(self.path, message, decode))
                    session.messages.setdefault(message.topic, []).append(recorded)
        return session


def seconds_of(stamp: Any) -> float:
    """A ROS stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def read_session(path: Path | str, since_ns: int = 0, until_ns: int = 1 << 64, topics: Collection[str] | None = None) -> Session:
    """Read a bag, or only what was logged within a span.

    Args:
        path: of the bag: a file, or a folder of rosbag2 with its files.
        since_ns: earliest log time (ROS time).
        until_ns: end of the span, itself left out.
        topics: that are decoded, such as "bridge/struts_sent"; None: all that can be.

    Raises:
        BagError: one line with the cause and what to do: missing, no MCAP file, cut short, damaged, too large, or of other types.
    """
    return read_bag(path, topics).session(since_ns, until_ns, required=topics is not None)


def read_bag(path: Path | str, topics: Collection[str] | None = None) -> Bag:
    """Read a bag without decoding a message. Args, Raises: as `read_session`."""
    file = Path(path)
    if file.suffix == ".mcap" and not file.exists() and is_bag_folder(file.with_suffix("")):
        file = file.with_suffix("")  # as the bridge's bags were called when they were single files
    try:
        bag, size = Bag(file), 0
        for part in files_of(file):
            with part.open("rb") as stream:
                read = _Reading(part, stream, os.fstat(stream.fileno()).st_size, topics).bag()
            bag.messages += read.messages
            bag.attachments |= read.attachments
            bag.metadata |= read.metadata
            size += sum(len(message.data) for message in read.messages)
            if len(bag.messages) > MOST_MESSAGES or size > MOST_WANTED:
                raise BagError(f"{file} {_TOO_LARGE}: give its files one by one")
    except OSError as error:
        raise BagError(
            f"cannot read bag {error.filename or file}: {error.strerror}; give a bag's folder, or an .mcap file"
        ) from error
    bag.messages.sort(key=lambda message: message.log_time_ns)
    return bag


def live_name(topic: str) -> str:
    """A recorded topic without the recording prefix and leading slash."""
    return topic.removeprefix("/recorded/").lstrip("/")


class _Topic(NamedTuple):
    topic: str
    encoding: str
    schema: tuple[str, str, str] | None
    wanted: bool


class _Reading:
    """One pass through a file."""

    def __init__(self, path: Path, stream: BinaryIO, size: int, topics: Collection[str] | None) -> None:
        self._bag = Bag(path)
        self._stream, self._size = stream, size
        self._topics = topics
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, _Topic] = {}
        self._records = self._wanted = self._unpacked = self._attached = 0
        self._at = 0
        self._crc = 0

    def _fail(self, problem: str, remedy: str = _COPY) -> BagError:
        return BagError(f"{self._bag.path} {problem}: {remedy}")

    def _damaged(self, problem: str) -> BagError:
        return self._fail(f"is damaged at byte {self._at}, {problem}")

    def bag(self) -> Bag:
        """Everything wanted. Raises BagError, OSError."""
        self._read_magic()
        first = True
        while True:
            opcode, body = self._record(first)
            first = False
            if opcode == Opcode.FOOTER:
                return self._bag
            try:
                self._take(opcode, body)
            except (McapError, zstandard.ZstdError, RuntimeError, EOFError, struct.error, ValueError) as error:
                raise self._damaged(f"a record of kind {opcode} makes no sense ({printable(str(error), 80)})") from error

    def _read_magic(self) -> None:
        start = self._stream.read(len(MAGIC))
        self._crc = zlib.crc32(start)
        if start == MAGIC:
            self._at = len(start)
            return
        if not start:
            raise self._fail("is empty", "nothing was recorded in it, give another bag")
        if (start + self._stream.read(8)).startswith(b"SQLite format 3"):
            raise self._fail("is a bag of rosbag2's sqlite3 storage", CONVERT)
        if start.startswith(b"\x28\xb5\x2f\xfd"):
            raise self._fail("is compressed as a whole", "unpack it with `zstd -d` first")
        if MAGIC.startswith(start):
            raise self._cut()
        raise self._fail(f"is no MCAP file (it begins with {start!r})", "give an .mcap file that the bridge recorded")

    def _cut(self) -> BagError:
        path = self._bag.path
        if path.suffix == ".journal":
            return self._fail("is the journal of a session that lives or was cut short", AT_ITS_END)
        journal = path.with_name(path.name + ".journal")
        if journal.exists():
            return self._fail(f"is being written, {journal.name} lies beside it", "wait until the bridge has closed it")
        remedy = "copy it again, or save what is left with `mcap recover` (github.com/foxglove/mcap)"
        return self._fail(f"is cut short after {self._size} bytes", remedy)

    def _record(self, first: bool) -> tuple[int, bytes]:
        """The next one, with the checksums that end a section checked."""
        frame = self._stream.read(FRAME.size)
        if len(frame) < FRAME.size:
            raise self._cut()
        opcode, length = FRAME.unpack(frame)
        if first and opcode != Opcode.HEADER:
            raise self._damaged("it does not begin with a header")
        left = self._size - self._at - FRAME.size
        if length > left:
            if length > MOST_RECORD and left > MOST_RECORD:
                raise self._damaged(f"a record says that it has {length} bytes")
            raise self._cut()
        if length > MOST_RECORD:
            raise self._damaged(f"a record says that it has {length} bytes, {MOST_RECORD} are read")
        body = self._stream.read(length)
        if len(body) < length:
            raise self._cut()
        if opcode == Opcode.DATA_END:
            (expected,) = struct.unpack_from("<I", body) if len(body) >= 4 else (1,)
            if expected and expected != self._crc:
                raise self._damaged("the checksum of all before does not fit")
            self._crc = 0
        elif opcode == Opcode.FOOTER:
            (expected,) = struct.unpack_from("<I", body, 16) if len(body) >= 20 else (1,)
            if expected and expected != zlib.crc32(body[:16], zlib.crc32(frame, self._crc)):
                raise self._damaged("the checksum of its index does not fit")
            if self._stream.read(len(MAGIC)) != MAGIC:
                raise self._cut()
        else:
            self._crc = zlib.crc32(body, zlib.crc32(frame, self._crc))
        self._at += FRAME.size + length
        return opcode, body

    def _take(self, opcode: int, body: bytes) -> None:
        fields = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(fields)
                if len(self._schemas) >= MOST_CHANNELS:
                    raise self._damaged(f"more than {MOST_CHANNELS} definitions")
                definition = schema.data.decode("utf-8", errors="replace")
                self._schemas.setdefault(schema.id, (schema.name, schema.encoding, definition))
            case Opcode.CHANNEL:
                channel = Channel.read(fields)
                topic, of_type = live_name(channel.topic), self._schemas.get(channel.schema_id)
                known = _Topic(topic, channel.message_encoding, of_type, is_among(topic, self._topics))
                self._channels.setdefault(channel.id, known)
            case Opcode.MESSAGE:
                self._take_message(body, 0, len(body))
            case Opcode.CHUNK:
                self._take_chunk(Chunk.read(fields))
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(fields)
                (crc,) = struct.unpack_from("<I", body, len(body) - 4)
                if crc and zlib.crc32(body[:-4]) != crc:
                    raise self._damaged(f"the checksum of attachment {printable(attachment.name, 40)} does not fit")
                self._keep(len(attachment.data))
                self._bag.attachments[attachment.name] = attachment.data
            case Opcode.METADATA:
                metadata = Metadata.read(fields)
                self._keep(len(body))
                self._bag.metadata[metadata.name] = metadata.metadata

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        number, _, log_time, _ = MESSAGE_HEAD.unpack_from(data, start)
        channel = self._channels.get(number)
        if channel is None:
            raise self._damaged(f"a message of channel {number}, which it does not declare")
        if not channel.wanted:
            return
        self._wanted += end - start
        if len(self._bag.messages) >= MOST_MESSAGES or self._wanted > min(MOST_WANTED, FREE + 100 * self._size):
            raise self._fail(_TOO_LARGE, f"at most {MOST_MESSAGES} messages and 1 GB are")
        schema = channel.schema or ("", "", "")
        encoding = channel.encoding if schema[1] in ("ros2msg", "") or channel.encoding != "cdr" else f"cdr with {schema[1]}"
        body = data[start + MESSAGE_HEAD.size : end]
        self._bag.messages.append(Raw(channel.topic, schema[0], schema[2], encoding, log_time, body))

    def _take_chunk(self, chunk: Chunk) -> None:
        self._unpacked += chunk.uncompressed_size
        if chunk.uncompressed_size > MOST_CHUNK or self._unpacked > FREE + MOST_RATIO * self._size:
            raise self._fail(f"unpacks to more than its {self._size} bytes can be worth", "it was not made by a recorder")
        data = self._unpack(chunk)
        if len(data) != chunk.uncompressed_size:
            raise self._damaged("a chunk does not unpack to what it says")
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise self._damaged("the checksum of a chunk does not fit")
        at = 0
        while at < len(data):
            opcode, length = FRAME.unpack_from(data, at)
            at += FRAME.size
            self._records += 1
            if opcode == 0 or length > len(data) - at:
                raise self._damaged("a record in a chunk makes no sense")
            if self._records > FREE_RECORDS + self._size:
                raise self._fail(f"has more records than its {self._size} bytes can be worth", "it was not made by a recorder")
            if opcode == Opcode.MESSAGE:
                self._take_message(data, at, at + length)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[at : at + length])
            at += length

    def _unpack(self, chunk: Chunk) -> bytes:
        """A chunk's records: no more memory is used than was said and permitted."""
        size = chunk.uncompressed_size
        match chunk.compression:
            case "":
                return chunk.data
            case "zstd":
                told = zstandard.frame_content_size(chunk.data)  # what it says itself would be believed
                if told not in (-1, size):
                    raise self._damaged(f"a chunk of {size} bytes says that it has {told}")
                return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size) if size else b""
            case "lz4":
                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1))
        other = printable(chunk.compression, 20)
        raise self._fail(f"is compressed with {other}, which is not known here", "record it again with zstd, lz4 or none")

    def _keep(self, size: int) -> None:
        self._attached += size + 100
        if self._attached > MOST_ATTACHED:
            raise self._fail(f"carries more than {MOST_ATTACHED >> 20} MB of attachments and metadata", "give another bag")


def is_among(topic: str, topics: Collection[str] | None) -> bool:
    """Whether a topic is one of these, in whatever namespace; None: all are."""
    return topics is None or any(topic == wanted or topic.endswith("/" + wanted) for wanted in topics)


def _decoder(path: Path, message: Raw, required: bool) -> Callable[[bytes], Any] | None:
    """What decodes messages like this one, by the definition in their bag.

    None: they are of a topic that nobody requires, and foreign. Raises BagError.
    """
    from mcap_ros2.decoder import DecoderFactory

    misfit = misfit_of(message.topic, message.type_name, message.definition, message.encoding)
    if misfit is None and message.encoding == "cdr":
        definition = Schema(id=1, name=message.type_name, encoding="ros2msg", data=message.definition.encode())
        try:
            return DecoderFactory().decoder_for("cdr", definition)
        except Exception as error:
            misfit = f"its definition cannot be understood ({printable(str(error), 60)})"
    if misfit is None and not required:
        return None
    problem = misfit or f"is in {printable(message.encoding, 30)}, valid is cdr with a ros2msg definition"
    raise BagError(f"{path}: topic {printable(message.topic, 60)}: {problem}; record it with the bridge")


def _decoded(path: Path, message: Raw, decode: Callable[[bytes], Any]) -> Any:
    try:
        return decode(message.data)
    except Exception as error:
        where = f"{printable(message.topic, 60)} at {message.log_time_ns} ns"
        raise BagError(
            f"{path}: a message of {where} does not fit its definition ({printable(str(error), 60)}): "
            "the bag was changed or is damaged, copy it again"
        ) from error
