# SPDX-License-Identifier: Apache-2.0
"""Bags from anywhere: each cause has its line, and no bag takes more memory or work than it can be worth."""

import random
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from hardware_bridge.errors import BagError, SchemaError
from hardware_bridge.recording.bag_reader import read_bag, read_session
from hardware_bridge.recording.bag_types import TOPICS, misfit_of
from tests.hardware_bridge.recording.test_message_definitions import SCHEMAS
from tests.scale import examples

EXAMPLE = Path(__file__).parents[3] / "bags" / "example"
FRAME = struct.Struct("<BQ")
STRING = b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00"


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(opcode: int, body: bytes) -> bytes:
    return FRAME.pack(opcode, len(body)) + body


MAGIC = b"\x89MCAP0\r\n"
HEADER = record(1, text("ros2") + text("test"))
END = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC


def file(*records: bytes) -> bytes:
    return b"".join((MAGIC, HEADER, *records, END))


def chunk(packed: bytes, unpacked: int, compression: str = "zstd", crc: int = 0) -> bytes:
    head = struct.pack("<QQQI", 0, 0, unpacked, crc) + text(compression)
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def schema(name: str = "std_msgs/msg/String", definition: str = "string data\n", number: int = 1) -> bytes:
    return record(3, struct.pack("<H", number) + text(name) + text("ros2msg") + text(definition))


def channel(topic: str = "/recorded/x", encoding: str = "cdr", number: int = 1) -> bytes:
    return record(4, struct.pack("<HH", number, 1) + text(topic) + text(encoding) + struct.pack("<I", 0))


def message(data: bytes = STRING, number: int = 1, log_time: int = 1) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, log_time, log_time) + data)


def written(path: Path, compression: CompressionType = CompressionType.ZSTD) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, enable_data_crcs=True)
        writer.start("ros2", "test")
        number = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        own = writer.register_channel("/recorded/x", "cdr", number)
        for index in range(200):
            writer.add_message(own, 10 + index, STRING, 10 + index, index)
        writer.add_attachment(1, 1, "library.yaml", "text/plain", b"schema: 1\n")
        writer.add_metadata("session", {"port": "p"})
        writer.finish()
    return path


def refusal(path: Path, **how) -> str:
    with pytest.raises(BagError) as caught:
        read_session(path, **how)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 400 + len(str(path))
    assert str(path) in line
    return line


def assert_short(error: BagError) -> None:
    assert str(error).isprintable()
    assert len(str(error)) < 1000


# ---- honest bags --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", CompressionType)
def test_a_bag_is_read_with_what_goes_with_it(tmp_path, compression):
    session = read_session(written(tmp_path / "a.mcap", compression))
    assert [message.data for message in session.of("x")] == ["a"] * 200
    assert session.attachments == {"library.yaml": b"schema: 1\n"}
    assert session.metadata == {"session": {"port": "p"}}
    some = read_session(tmp_path / "a.mcap", since_ns=20, until_ns=30)
    assert [recorded.log_time_ns for recorded in some.recorded("x")] == list(range(20, 30))
    assert some.attachments


def test_messages_come_in_the_order_of_their_log_times(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(file(schema(), channel(), message(log_time=3), message(log_time=1), message(log_time=2)))
    assert [message.log_time_ns for message in read_bag(path).messages] == [1, 2, 3]


def test_only_the_topics_that_are_wanted_are_decoded(tmp_path):
    path = tmp_path / "a.mcap"
    foreign = message(b'{"a": 1}', 2)
    path.write_bytes(file(schema(), channel("/recorded/ns/x"), channel("/other", "json", 2), message(), foreign))
    assert set(read_session(path, topics=["x"]).messages) == {"ns/x"}
    assert set(read_session(path).messages) == {"ns/x"}
    assert "topic other: is in json, valid is cdr" in refusal(path, topics=["other"])


def test_every_type_that_is_read_is_in_todays_messages_and_in_the_example():
    for topic, (type_name, _) in TOPICS.items():
        try:
            definition = SCHEMAS.schema_text(type_name)
        except SchemaError:
            pytest.skip("the messages are not built here")
        assert misfit_of(topic, type_name, definition, "cdr") is None
    session = read_session(EXAMPLE, topics=TOPICS)
    assert set(session.messages) == set(TOPICS) - {"bridge/trial", "imu/data", "face_estimate"}  # it has no inertial sensor


# ---- each cause has its own line -------------------------------------------------------------------------------------------

CAUSES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "nothing in it": (lambda data: b"", "is empty"),
    "text": (lambda data: b"hello, this is not a bag", "is no MCAP file (it begins with b'hello, t')"),
    "sqlite": (lambda data: b"SQLite format 3\x00" + bytes(100), "sqlite3 storage: convert it with `ros2 bag convert`"),
    "zstd": (lambda data: zstandard.compress(data), "is compressed as a whole: unpack it with `zstd -d`"),
    "cut": (lambda data: data[: len(data) // 2], "is cut short after"),
    "cut at its end": (lambda data: data[:-1], "is cut short after"),
    "cut in its beginning": (lambda data: data[:5], "is cut short after 5 bytes"),
    "a bit of a chunk": (lambda data: flipped(data, data.index(b"\x28\xb5\x2f\xfd") + 30), "is damaged at byte"),
    "a bit of an attachment": (lambda data: flipped(data, data.index(b"schema: 1")), "the checksum of attachment library.yaml"),
    "a bit of metadata": (lambda data: flipped(data, data.index(b"port")), "the checksum of all before does not fit"),
    "a bit of the index": (lambda data: flipped(data, data.rindex(b"std_msgs")), "the checksum of its index does not fit"),
}


def flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]


@pytest.mark.parametrize("cause", CAUSES)
def test_each_cause_has_its_own_line(tmp_path, cause):
    change, told = CAUSES[cause]
    data = written(tmp_path / "good.mcap").read_bytes()
    path = tmp_path / "bad.mcap"
    path.write_bytes(change(data))
    assert told in refusal(path)


def folder(path: Path, names: list[str], storage: str = "mcap", packed: str = "") -> Path:
    """What rosbag2 writes beside its files."""
    listed = "".join(f"\n    - {name}" for name in names)
    text = (
        f"rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: {storage}\n  duration:\n    nanoseconds: 7\n"
        f'  relative_file_paths:{listed}\n  compression_format: ""\n  compression_mode: "{packed}"\n  custom_data: ~\n'
    )
    path.mkdir(exist_ok=True)
    (path / "metadata.yaml").write_text(text, encoding="utf-8")
    return path


def test_a_folder_of_rosbag2_is_one_bag(tmp_path):
    bag = folder(tmp_path / "rosbag", ["b_1.mcap", "rosbag/b_0.mcap"])
    (bag / "b_0.mcap").write_bytes(file(schema(), channel("/bridge/x"), message(log_time=5), message(log_time=7)))
    (bag / "b_1.mcap").write_bytes(file(schema(), channel("/bridge/x"), message(log_time=6)))
    (bag / "other.mcap").write_bytes(b"of no bag")
    assert [found.log_time_ns for found in read_session(bag).recorded("bridge/x")] == [5, 6, 7]
    assert read_bag(bag).path == bag


@pytest.mark.parametrize(
    ("told", "line"),
    [
        ({"storage": "sqlite3", "names": ["b_0.db3"]}, "is a bag of rosbag2's sqlite3 storage: convert it with `ros2 bag convert`"),
        ({"names": ["b_0.mcap"], "packed": "MESSAGE"}, "has messages compressed one by one: convert it with `ros2 bag convert`"),
        ({"names": ["gone.mcap"]}, "gone.mcap: No such file or directory"),
        ({"names": ["b_0.mcap"] * 1001}, "names 1001 files, valid are 1 to 1000"),
        ({"names": []}, "makes no sense (rosbag2 did not write it): write it again with `ros2 bag reindex`"),
    ],
)
def test_a_folder_that_is_no_bag_says_why(tmp_path, told, line):
    assert line in refusal(folder(tmp_path / "bag", **told))


def test_a_bag_is_found_by_the_name_of_the_single_file_that_it_once_was():
    assert read_bag(EXAMPLE.with_suffix(".mcap")).path == EXAMPLE


def test_a_damaged_list_of_a_folders_files_is_told(tmp_path):
    bag = folder(tmp_path / "bag", ["a.mcap"])
    for damaged in (b"", b"[1]", b"rosbag2_bagfile_information: 3", bytes(4096), b"a: 1\na: 2", b"\xff"):
        (bag / "metadata.yaml").write_bytes(damaged)
        assert "write it again with `ros2 bag reindex`" in refusal(bag)


def test_a_folder_is_told_with_what_is_in_it(tmp_path):
    assert "is a folder without metadata.yaml, and there is no .mcap file in it" in refusal(tmp_path)
    (tmp_path / "a.mcap").write_bytes(b"")
    assert "it holds a.mcap: give an .mcap file of the bridge, or write its metadata.yaml with `ros2 bag reindex`" in refusal(
        tmp_path
    )


def test_a_journal_and_a_bag_that_is_being_written_say_how_they_become_one(tmp_path):
    data = written(tmp_path / "a.mcap").read_bytes()
    journal = tmp_path / "s.mcap.journal"
    journal.write_bytes(data[:-100])
    assert "the bridge makes a bag of it at its next start with this bag_folder" in refusal(journal)
    (tmp_path / "s.mcap").write_bytes(data[:-100])
    assert "s.mcap.journal lies beside it: wait until the bridge has closed it" in refusal(tmp_path / "s.mcap")


def test_foreign_types_under_our_names_are_told(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(file(schema(), channel("/recorded/bridge/struts_sent"), message()))
    assert "is of type std_msgs/msg/String, valid is tensegrity_interfaces/msg/StrutsSent" in refusal(path)
    ours = schema("tensegrity_interfaces/msg/StrutsSent")
    path.write_bytes(file(ours, channel("/recorded/bridge/struts_sent"), message()))
    assert "topic bridge/struts_sent: has no field" in refusal(path)
    path.write_bytes(file(ours, channel("/recorded/bridge/struts_sent", "protobuf"), message()))
    assert "is in protobuf, valid is cdr" in refusal(path)


def test_names_with_escape_codes_stay_out_of_the_terminal(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(file(schema(), channel("/recorded/\x1b[31mred" + "x" * 10_000, "\x1b]0;title"), message()))
    refusal(path, topics=["\x1b[31mred" + "x" * 10_000])


# ---- bombs ------------------------------------------------------------------------------------------------------------------


def zeros(size: int) -> bytes:
    return zstandard.ZstdCompressor(level=1).compress(bytes(size))


def lying(size: int) -> bytes:
    """A zstd frame that does not say how large it is."""
    return zstandard.ZstdCompressor(level=3, write_content_size=False).compress(bytes(size))


MB = 1 << 20
BOMBS: dict[str, Callable[[], bytes]] = {
    "a chunk that unpacks to gigabytes": lambda: file(chunk(zeros(60 * MB), 5 << 30)),
    "many chunks that unpack to gigabytes": lambda: file(*[chunk(zeros(60 * MB), 60 * MB)] * 80),
    "a chunk that says less than it unpacks to": lambda: file(chunk(zeros(600 * MB), 1000)),
    "a chunk that says nothing and unpacks to more": lambda: file(chunk(lying(600 * MB), 1000)),
    "lz4": lambda: file(chunk(lz4.frame.compress(bytes(600 * MB)), 1000, "lz4")),
    "a record as long as the universe": lambda: MAGIC + FRAME.pack(1, 2**63) + bytes(100),
    "a record longer than the file": lambda: MAGIC + HEADER + FRAME.pack(5, 2**40) + bytes(100),
    "a record in a chunk longer than the chunk": lambda: file(chunk(zstandard.compress(FRAME.pack(5, 2**60)), 9)),
    "text longer than its record": lambda: file(record(3, b"\x01\x00" + struct.pack("<I", 2**32 - 1))),
    "records of nothing": lambda: file(chunk(zstandard.compress(FRAME.pack(0x81, 0) * 4_000_000), 36_000_000)),
    "attachments": lambda: file(*[record(9, bytes(16) + text("a") + text("b") + struct.pack("<Q", MB) + bytes(MB + 4))] * 70),
    "a channel that is not declared": lambda: file(message()),
    "an unknown compression": lambda: file(chunk(b"abc", 3, "\x1b[31m" * 1000)),
    "a definition of nothing, many times": lambda: file(
        schema(definition="Empty[] a\n===\nMSG: std_msgs/Empty\nuint8[0] b\n"), channel(), message(b"\x00\x01" + b"\xff" * 8)
    ),
    "a definition that contains itself": lambda: file(
        schema(definition="Loop a\n===\nMSG: std_msgs/Loop\nLoop b\n"), channel(), message()
    ),
    "an array of two milliards": lambda: file(
        schema(definition="float64[] a\n"), channel(), message(b"\x00\x01\x00\x00" + struct.pack("<I", 2**31) + bytes(16))
    ),
    "texts of two milliards": lambda: file(
        schema(definition="string[] a\n"), channel(), message(b"\x00\x01\x00\x00" + struct.pack("<I", 2**31) + bytes(16))
    ),
    "an array of fixed length": lambda: file(schema(definition="int32[4000000000] a\n"), channel(), message()),
}
READ = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (500 << 20, 500 << 20))
from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_reader import read_session
for path in sorted(Path(sys.argv[1]).glob("*.mcap")):
    try:
        read_session(path, topics=["x"])
        print("read")
    except BagError as error:
        print(len(str(error)) < 1000, str(error).isprintable(), error)
"""


def test_no_bomb_takes_more_memory_than_a_bag_may(tmp_path):
    """All in one child that has 500 MB, Python and libraries included."""
    for number, bomb in enumerate(BOMBS.values()):
        (tmp_path / f"{number:02}.mcap").write_bytes(bomb())
    done = subprocess.run([sys.executable, "-c", READ, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    lines = done.stdout.splitlines()
    assert len(lines) == len(BOMBS)
    for line, what in zip(lines, BOMBS, strict=True):
        assert line.startswith("True True "), (what, line)


def test_too_many_messages_are_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("hardware_bridge.recording.bag_reader.MOST_MESSAGES", 100)
    assert "is too large to be read at once" in refusal(written(tmp_path / "a.mcap"))
    assert read_bag(tmp_path / "a.mcap", topics=["other"]).messages == []


# ---- whatever is done to a bag ------------------------------------------------------------------------------------------------


def test_no_single_bit_is_read_with_other_data(tmp_path):
    path = written(tmp_path / "a.mcap")
    good, whole = path.read_bytes(), read_session(path)
    rng = random.Random(7)
    for _ in range(300):
        data = bytearray(good)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
        try:
            session = read_session(path)
        except BagError as error:
            assert_short(error)
            continue
        assert [m.data for m in session.of("x")] == [m.data for m in whole.of("x")]
        assert (session.attachments, session.metadata) == (whole.attachments, whole.metadata)


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> bytes:
    return written(tmp_path_factory.mktemp("bag") / "a.mcap", CompressionType.NONE).read_bytes()


@settings(max_examples=examples(300), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=20), st.integers(0, 20)), min_size=1, max_size=3))
def test_whatever_bytes_a_bag_comes_of_it_or_the_error(tmp_path, small, edits):
    data = bytearray(small)
    for where, new, removed in edits:
        at = int(where * len(data))
        data[at : at + removed] = new
    path = tmp_path / "any.mcap"
    path.write_bytes(bytes(data))
    try:
        read_session(path, topics=["x", "bridge/face"])
    except BagError as error:
        assert_short(error)


@settings(max_examples=examples(150), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(definition=st.text(alphabet="abint8 float64[]<=>string/Time\n=#MSG:*9.", max_size=80), body=st.binary(max_size=60))
def test_whatever_definition_a_bag_comes_of_it_or_the_error(tmp_path, definition, body):
    path = tmp_path / "any.mcap"
    path.write_bytes(file(schema(definition=definition), channel(), message(body)))
    try:
        read_session(path, topics=["x"])
    except BagError as error:
        assert_short(error)
