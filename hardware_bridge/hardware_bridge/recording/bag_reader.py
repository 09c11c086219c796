# SPDX-License-Identifier: Apache-2.0
"""The one opener of bags, with no ROS installed: what was sent, what was seen, what the twin said.

A bag comes from anywhere. So it is read once from its beginning to its end, checksums on, and nothing that it says about itself is
believed before it is bounded: records by the file's size, chunks by what they say they unpack to and by what they do, all of them
together by the file's size, messages by their number. Only the topics that are wanted are decoded, and those of ours only if they
have the fields that are read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from hardware_bridge.errors import BridgeError
from hardware_bridge.recording.bag_types import misfit_of
from sim_core.printable import printable

MAGIC = b"\x89MCAP0\r\n"
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

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_ATTACHMENT, _METADATA, _DATA_END = 9, 12, 15
_FRAME = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_COPY = "copy it again from where it was recorded"


class BagError(BridgeError):
    """A bag that cannot be read."""


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
        path: the file.
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
        decoders = _Decoders(self.path)
        for message in self.messages:
            if since_ns <= message.log_time_ns < until_ns:
                decoded = decoders.decoded(message, required)
                if decoded is not None:
                    recorded = Recorded(message.topic, message.log_time_ns, decoded)
                    session.messages.setdefault(message.topic, []).append(recorded)
        return session


def seconds_of(stamp: Any) -> float:
    """A ROS stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def read_session(
    path: Path | str, since_ns: int | None = None, until_ns: int | None = None, topics: Collection[str] | None = None
) -> Session:
    """Read a bag, or only what was logged within a span.

    Args:
        path: of the bag.
        since_ns: earliest log time (ROS time); None: from the beginning.
        until_ns: end of the span, itself left out; None: to the end.
        topics: that are decoded, such as "bridge/struts_sent"; None: all that can be.

    Raises:
        BagError: one line with the cause and what to do: missing, no MCAP file, cut short, damaged, too large, or of other types.
    """
    return read_bag(path, since_ns, until_ns, topics).session(required=topics is not None)


def read_bag(
    path: Path | str, since_ns: int | None = None, until_ns: int | None = None, topics: Collection[str] | None = None
) -> Bag:
    """Read a bag without decoding a message. Args, Raises: as `read_session`."""
    file = Path(path)
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            bag = _Reading(file, stream, size, since_ns, until_ns, topics).bag()
    except IsADirectoryError as error:
        inside = sorted(file.glob("*.mcap"))
        what = f"it holds {inside[0].name}" if inside else "there is no .mcap file in it"
        raise BagError(f"{file} is a folder, and {what}: give an .mcap file") from error
    except OSError as error:
        raise BagError(f"cannot read bag {file}: {error.strerror}; give the path of an .mcap file") from error
    bag.messages.sort(key=lambda message: message.log_time_ns)
    return bag


def live_name(topic: str) -> str:
    """A recorded topic without the recording prefix and leading slash."""
    return topic.removeprefix("/recorded/").lstrip("/")


class _Channel(NamedTuple):
    topic: str
    encoding: str
    schema: tuple[str, str, str] | None
    wanted: bool


class _Reading:
    """One pass through a file."""

    def __init__(
        self,
        path: Path,
        stream: BinaryIO,
        size: int,
        since_ns: int | None,
        until_ns: int | None,
        topics: Collection[str] | None,
    ):
        self._bag = Bag(path)
        self._stream, self._size = stream, size
        self._since = 0 if since_ns is None else since_ns
        self._until = 1 << 64 if until_ns is None else until_ns
        self._topics = topics
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, _Channel] = {}
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
            if opcode == _FOOTER:
                return self._bag
            try:
                self._take(opcode, body)
            except BagError:
                raise
            except (struct.error, ValueError, EOFError, IndexError) as error:
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
            remedy = "convert it with `ros2 bag convert` to storage mcap, or give an .mcap file"
            raise self._fail("is a bag of rosbag2's sqlite3 storage", remedy)
        if start.startswith(b"\x28\xb5\x2f\xfd"):
            raise self._fail("is compressed as a whole", "unpack it with `zstd -d` first")
        if MAGIC.startswith(start):
            raise self._cut()
        raise self._fail(f"is no MCAP file (it begins with {start!r})", "give an .mcap file that the bridge recorded")

    def _cut(self) -> BagError:
        path = self._bag.path
        if path.suffix == ".journal":
            remedy = "the bridge makes a bag of it at its next start with this bag_folder, or when that session ends"
            return self._fail("is the journal of a session that lives or was cut short", remedy)
        journal = path.with_name(path.name + ".journal")
        if journal.exists():
            return self._fail(f"is being written, {journal.name} lies beside it", "wait until the bridge has closed it")
        remedy = "copy it again, or save what is left with `mcap recover` (github.com/foxglove/mcap)"
        return self._fail(f"is cut short after {self._size} bytes", remedy)

    def _record(self, first: bool) -> tuple[int, bytes]:
        """The next one, with the checksums that end a section checked."""
        frame = self._stream.read(_FRAME.size)
        if len(frame) < _FRAME.size:
            raise self._cut()
        opcode, length = _FRAME.unpack(frame)
        if first and opcode != _HEADER:
            raise self._damaged("it does not begin with a header")
        left = self._size - self._at - _FRAME.size
        if length > left:
            if length > MOST_RECORD and left > MOST_RECORD:
                raise self._damaged(f"a record says that it has {length} bytes")
            raise self._cut()
        if length > MOST_RECORD:
            raise self._damaged(f"a record says that it has {length} bytes, {MOST_RECORD} are read")
        body = self._stream.read(length)
        if len(body) < length:
            raise self._cut()
        if opcode == _DATA_END:
            (expected,) = struct.unpack_from("<I", body) if len(body) >= 4 else (1,)
            if expected and expected != self._crc:
                raise self._damaged("the checksum of all before does not fit")
            self._crc = 0
        elif opcode == _FOOTER:
            (expected,) = struct.unpack_from("<I", body, 16) if len(body) >= 20 else (1,)
            if expected and expected != zlib.crc32(body[:16], zlib.crc32(frame, self._crc)):
                raise self._damaged("the checksum of its index does not fit")
            if self._stream.read(len(MAGIC)) != MAGIC:
                raise self._cut()
        else:
            self._crc = zlib.crc32(body, zlib.crc32(frame, self._crc))
        self._at += _FRAME.size + length
        return opcode, body

    def _take(self, opcode: int, body: bytes) -> None:
        if opcode == _SCHEMA:
            self._take_schema(body)
        elif opcode == _CHANNEL:
            self._take_channel(body)
        elif opcode == _MESSAGE:
            self._take_message(body, 0, len(body))
        elif opcode == _CHUNK:
            self._take_chunk(body)
        elif opcode == _ATTACHMENT:
            self._take_attachment(body)
        elif opcode == _METADATA:
            self._take_metadata(body)

    def _take_schema(self, body: bytes) -> None:
        reader = _Fields(body)
        number = reader.number("<H")
        name, encoding = reader.text(), reader.text()
        if len(self._schemas) >= MOST_CHANNELS:
            raise self._damaged(f"more than {MOST_CHANNELS} definitions")
        self._schemas.setdefault(number, (name, encoding, reader.blob("<I").decode("utf-8", errors="replace")))

    def _take_channel(self, body: bytes) -> None:
        reader = _Fields(body)
        number, schema = reader.number("<H"), reader.number("<H")
        topic, encoding = live_name(reader.text()), reader.text()
        if number not in self._channels:
            self._channels[number] = _Channel(topic, encoding, self._schemas.get(schema), is_among(topic, self._topics))

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        number, _, log_time, _ = _MESSAGE_HEAD.unpack_from(data, start)
        channel = self._channels.get(number)
        if channel is None:
            raise self._damaged(f"a message of channel {number}, which it does not declare")
        if not channel.wanted or not self._since <= log_time < self._until:
            return
        self._wanted += end - start
        if len(self._bag.messages) >= MOST_MESSAGES or self._wanted > min(MOST_WANTED, FREE + 100 * self._size):
            raise self._fail("is too large to be read at once", f"at most {MOST_MESSAGES} messages and 1 GB are")
        schema = channel.schema or ("", "", "")
        encoding = channel.encoding if schema[1] in ("ros2msg", "") or channel.encoding != "cdr" else f"cdr with {schema[1]}"
        body = data[start + _MESSAGE_HEAD.size : end]
        self._bag.messages.append(Raw(channel.topic, schema[0], schema[2], encoding, log_time, body))

    def _take_chunk(self, body: bytes) -> None:
        _, _, unpacked, crc, length = _CHUNK_HEAD.unpack_from(body)
        compression = body[_CHUNK_HEAD.size : _CHUNK_HEAD.size + length].decode("ascii")
        packed = memoryview(body)[_CHUNK_HEAD.size + length + 8 :]
        self._unpacked += unpacked
        if unpacked > MOST_CHUNK or self._unpacked > FREE + MOST_RATIO * self._size:
            raise self._fail(f"unpacks to more than its {self._size} bytes can be worth", "it was not made by a recorder")
        data = self._unpack(compression, packed, unpacked)
        if crc and zlib.crc32(data) != crc:
            raise self._damaged("the checksum of a chunk does not fit")
        at = 0
        while at < len(data):
            opcode, length = _FRAME.unpack_from(data, at)
            at += _FRAME.size
            self._records += 1
            if opcode == 0 or length > len(data) - at:
                raise self._damaged("a record in a chunk makes no sense")
            if self._records > FREE_RECORDS + self._size:
                raise self._fail(f"has more records than its {self._size} bytes can be worth", "it was not made by a recorder")
            if opcode == _MESSAGE:
                self._take_message(data, at, at + length)
            elif opcode in (_SCHEMA, _CHANNEL):
                self._take(opcode, data[at : at + length])
            at += length

    def _unpack(self, compression: str, packed: memoryview, unpacked: int) -> bytes:
        """A chunk's records: no more memory is used than was said and permitted."""
        if compression == "":
            data = bytes(packed)
        elif compression == "zstd":
            data = _unpack_zstd(packed, unpacked)
        elif compression == "lz4":
            data = _unpack_lz4(packed, unpacked)
        else:
            remedy = "record it again with zstd, lz4 or none"
            raise self._fail(f"is compressed with {printable(compression, 20)}, which is not known here", remedy)
        if len(data) != unpacked:
            raise self._damaged("a chunk does not unpack to what it says")
        return data

    def _take_attachment(self, body: bytes) -> None:
        reader = _Fields(body)
        reader.number("<QQ")
        name = reader.text()
        reader.text()
        data = reader.blob("<Q")
        (crc,) = struct.unpack_from("<I", body, len(body) - 4)
        if crc and zlib.crc32(body[:-4]) != crc:
            raise self._damaged(f"the checksum of attachment {printable(name, 40)} does not fit")
        self._keep(len(data))
        self._bag.attachments[name] = data

    def _take_metadata(self, body: bytes) -> None:
        reader = _Fields(body)
        name, found = reader.text(), {}
        inner = _Fields(reader.blob("<I"))
        while inner.left:
            key = inner.text()
            found[key] = inner.text()
        self._keep(len(body))
        self._bag.metadata[name] = found

    def _keep(self, size: int) -> None:
        self._attached += size + 100
        if self._attached > MOST_ATTACHED:
            raise self._fail(f"carries more than {MOST_ATTACHED >> 20} MB of attachments and metadata", "give another bag")


def is_among(topic: str, topics: Collection[str] | None) -> bool:
    """Whether a topic is one of these, in whatever namespace; None: all are."""
    return topics is None or any(topic == wanted or topic.endswith("/" + wanted) for wanted in topics)


class _Fields:
    """A record's fields, one after the other; what a length says is never more than there is."""

    def __init__(self, data: bytes):
        self._data, self._at = data, 0

    @property
    def left(self) -> bool:
        return self._at < len(self._data)

    def number(self, layout: str) -> int:
        value = int(struct.unpack_from(layout, self._data, self._at)[0])
        self._at += struct.calcsize(layout)
        return value

    def blob(self, layout: str) -> bytes:
        length = self.number(layout)
        if length > len(self._data) - self._at:
            raise ValueError(f"{length} bytes are said, {len(self._data) - self._at} are there")
        self._at += length
        return self._data[self._at - length : self._at]

    def text(self) -> str:
        return self.blob("<I").decode("utf-8")


def _unpack_zstd(packed: memoryview, unpacked: int) -> bytes:
    import zstandard

    try:
        told = zstandard.frame_content_size(packed)  # what it says itself would be believed
        if told not in (-1, unpacked):
            raise ValueError(f"a chunk of {unpacked} bytes says that it has {told}")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=unpacked) if unpacked else b""
    except zstandard.ZstdError as error:
        raise ValueError(f"zstd: {error}") from error


def _unpack_lz4(packed: memoryview, unpacked: int) -> bytes:
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=unpacked + 1))
    except (RuntimeError, EOFError) as error:
        raise ValueError(f"lz4: {error}") from error


class _Decoders:
    """Decodes messages by the definitions in their bag."""

    def __init__(self, path: Path):
        self._path = path
        self._known: dict[tuple[str, str, str, str], Any] = {}

    def decoded(self, message: Raw, required: bool) -> Any:
        """The message, or None if it is of a topic that nobody requires, and foreign. Raises BagError."""
        key = (message.topic, message.type_name, message.encoding, message.definition)
        if key not in self._known:
            self._known[key] = self._decoder(message, required)
        decode = self._known[key]
        if decode is None:
            return None
        try:
            return decode(message.data)
        except (Exception, RecursionError) as error:
            where = f"{printable(message.topic, 60)} at {message.log_time_ns} ns"
            raise BagError(
                f"{self._path}: a message of {where} does not fit its definition ({printable(str(error), 60)}): "
                "the bag was changed or is damaged, copy it again"
            ) from error

    def _decoder(self, message: Raw, required: bool) -> Any:
        from mcap.records import Schema
        from mcap_ros2.decoder import DecoderFactory

        misfit = misfit_of(message.topic, message.type_name, message.definition, message.encoding)
        if misfit is None and message.encoding == "cdr":
            definition = Schema(id=1, name=message.type_name, encoding="ros2msg", data=message.definition.encode())
            try:
                return DecoderFactory().decoder_for("cdr", definition)
            except (Exception, RecursionError) as error:
                misfit = f"its definition cannot be understood ({printable(str(error), 60)})"
        if misfit is None and not required:
            return None
        problem = misfit or f"is in {printable(message.encoding, 30)}, valid is cdr with a ros2msg definition"
        raise BagError(f"{self._path}: topic {printable(message.topic, 60)}: {problem}; record it with the bridge")
