# SPDX-License-Identifier: Apache-2.0
"""Whatever happens to a file, its reader gives what was written, says that it was changed, or raises the project's own error."""

import io
import random
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from hardware_bridge.calibration.calibration_file import Calibration, load_calibration, write_calibration
from hardware_bridge.errors import BagError, BridgeError
from hardware_bridge.recording.bag_on_disk import file_of
from hardware_bridge.recording.bag_reader import read_bag, read_session
from hardware_bridge.recording.bag_types import TOPICS
from hardware_bridge.recording.journal import finish_journal
from sim_core.errors import SimError
from sim_core.files import yaml_reader
from sim_core.files.yaml_reader import sealed
from sim_core.gaits.library import library_text, load_library
from sim_core.gaits.success_counts import load_success_counts, success_counts_text
from sim_core.names import STRUT_NAMES
from sim_core.structure.parameters import FILE, load_prototype
from tensegrity_lab.session_data.folder import open_session
from tensegrity_lab.session_data.ledger import read_lines
from tests.hardware_bridge.recording.test_bag_reader import written
from tests.hardware_bridge.recording.test_journal import whole_journal
from tests.scale import ALL
from tests.tensegrity_lab.trials.sessions import Outcome, begun, planned, try_all

EXAMPLE = Path(__file__).parents[1] / "bags" / "example"
CASES = 1250 if ALL else 25
"""Of each kind."""


class Kind(NamedTuple):
    """A file, what reads it, and whether each part of it has its own checksum, so that a part of what was written may come."""

    path: Path
    read: Callable[[Path], Any]
    in_parts: bool = False


def damaged(whole: bytes, chance: random.Random) -> bytes:
    """A file as disks, networks and people leave it."""
    data, size = bytearray(whole), len(whole)
    for _ in range(chance.randint(1, 2)):
        at, there = sorted(chance.randrange(size) for _ in range(2))
        match chance.randrange(6):
            case 0:
                data[at : at + 1] = bytes([data[at] ^ 1 << chance.randrange(8)]) if at < len(data) else b""
            case 1:
                del data[there:]
            case 2:
                data[at : at + 64] = bytes(min(64, max(0, len(data) - at)))
            case 3:
                data[at : at + 50], data[there : there + 50] = data[there : there + 50], data[at : at + 50]
            case 4:
                del data[at : at + chance.randrange(1, 40)]
            case _:
                data[at:at] = data[there : there + 80]
    return bytes(data)


def texts(path: Path) -> list[tuple[str, int, bytes]]:
    return [(message.topic, message.log_time_ns, message.data) for message in read_bag(path).messages]


def of_journal(path: Path) -> list[tuple[str, int, bytes]]:
    bag = path.with_suffix(".made")
    bag.unlink(missing_ok=True)
    finish_journal(path, bag)
    return texts(bag)


def of_bag(path: Path) -> list[tuple[str, int, bytes]]:
    read_session(path)
    return texts(path)


def of_library(path: Path) -> Any:
    library = load_library(path)
    return library, library.hash


def of_plan(path: Path) -> Any:
    return open_session(path.parent).plan


def of_settings(path: Path) -> Any:
    return open_session(path.parent).settings


def of_ledger(path: Path) -> Any:
    return read_lines(path)[0]


def text_file(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def kinds(tmp_path_factory) -> dict[str, Kind]:
    folder = tmp_path_factory.mktemp("files")
    library = load_library()
    calibration: Calibration = load_calibration()
    session = begun(folder / "session", planned("1"))
    try_all(session, dict.fromkeys(range(6), Outcome.SUCCESS))
    write_calibration(
        folder / "calibration.yaml", calibration.mid_stroke_length_m, dict(zip(STRUT_NAMES, calibration.struts, strict=True))
    )
    journal = folder / "session.journal"
    journal.write_bytes(whole_journal(folder))
    counts = load_success_counts(library)
    assert counts is not None
    return {
        "bag": Kind(written(folder / "bag.mcap"), of_bag),
        "journal": Kind(journal, of_journal, in_parts=True),
        "library": Kind(text_file(folder / "library.yaml", library_text(library)), of_library),
        "odds": Kind(text_file(folder / "odds.yaml", success_counts_text(counts)), lambda path: load_success_counts(library, path)),
        "prototype": Kind(text_file(folder / "prototype.yaml", sealed(FILE.path.read_text(encoding="utf-8"))), load_prototype),
        "calibration": Kind(folder / "calibration.yaml", load_calibration),
        "settings": Kind(session.path / "session.yaml", of_settings),
        "plan": Kind(session.path / "plan.csv", of_plan),
        "ledger": Kind(session.path / "ledger.csv", of_ledger, in_parts=True),
    }


def own_rows() -> list[tuple[Any, Any, Any]]:
    """The first three messages of every topic of the example that is read."""
    rows: dict[str, list[tuple[Any, Any, Any]]] = {}
    for row in make_reader(io.BytesIO(file_of(EXAMPLE).read_bytes())).iter_messages():
        if len(rows.setdefault(row[1].topic, [])) < 3:
            rows[row[1].topic].append(row)
    return [row for topic in rows.values() for row in topic]


def beside_foreign_topics(path: Path, own: list[tuple[Any, Any, Any]], chance: random.Random, topics: Sequence[str]) -> None:
    """A bag in which others recorded too: any encoding, any schema, any bytes."""
    with path.open("wb") as stream:
        writer, channels = Writer(stream), {}
        writer.start("ros2", "somebody")
        foreign = []
        for number in range(chance.randint(1, 6) if topics else 0):
            encoding = chance.choice(["", "ros2msg", "ros2idl", "protobuf", "jsonschema", "?" * 300])
            text = chance.choice([b"", b"float64 x\n", b"{}", chance.randbytes(50), b"=" * 80 + b"\nMSG: a/B\n"])
            kind = writer.register_schema(chance.choice(["a/msg/B", "std_msgs/msg/String", ""]), encoding, text)
            name = chance.choice(topics).format(number)
            foreign.append(writer.register_channel(name, chance.choice(["cdr", "json", ""]), kind * (chance.random() < 0.8)))
        for schema, channel, message in own:
            for other in chance.sample(foreign, chance.randint(0, len(foreign))):
                writer.add_message(other, message.log_time, chance.randbytes(chance.choice([0, 3, 200])), 0)
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, kind)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()


def test_foreign_topics_change_nothing_of_what_is_read(tmp_path):
    own, chance, path = own_rows(), random.Random(3), tmp_path / "mixed.mcap"
    beside_foreign_topics(path, own, chance, ())
    right = [(m.topic, m.log_time_ns, m.data) for m in read_bag(path, TOPICS).messages]
    assert len(right) > 15
    names = ("/camera{}", "/recorded/camera{}", "/robot/bridge/faces{}", "/recorded/x/twin/states{}", "bell\a{}", "{}")
    for case in range(CASES):
        beside_foreign_topics(path, own, chance, names)
        assert [(m.topic, m.log_time_ns, m.data) for m in read_bag(path, TOPICS).messages] == right, f"case {case}"
        assert sum(map(len, read_session(path, topics=TOPICS).messages.values())) == len(right)


def test_a_topic_that_is_called_as_ours_and_is_none_is_told(tmp_path):
    own, chance, path = own_rows(), random.Random(4), tmp_path / "mixed.mcap"
    told: list[str] = []
    for _ in range(CASES):
        beside_foreign_topics(path, own, chance, ("/other{}/bridge/face",))
        try:
            read_session(path, topics=TOPICS)
        except BagError as error:
            told.append(str(error))
    assert len(told) > CASES // 2
    assert all(re.search("other[0-9]/bridge/face", line) and "\n" not in line for line in told)


NAMES = ("bag", "journal", "library", "odds", "prototype", "calibration", "settings", "plan", "ledger")


@pytest.mark.parametrize("name", NAMES)
def test_no_damage_is_taken_for_what_was_written(kinds, name, caplog, monkeypatch):
    monkeypatch.setattr(yaml_reader, "_told", set())
    kind = kinds[name]
    whole = kind.path.read_bytes()
    seal = whole.partition(b"\n")[0] if whole.startswith(b"# sha256") else b""  # without it, it is as a file of old
    lines: list[str] = []
    right = kind.read(kind.path)
    chance = random.Random(name)
    try:
        for case in range(CASES):
            broken = damaged(whole, chance)
            kind.path.write_bytes(broken)
            caplog.clear()
            yaml_reader._told.clear()
            try:
                found = kind.read(kind.path)
            except (SimError, BridgeError) as error:
                lines.append(str(error))
                continue
            told = any("edited by hand" in text for text in caplog.messages)
            fits = all(part in right for part in found) if kind.in_parts else found == right
            assert fits or told or (seal and seal not in broken), f"case {case}"
    finally:
        kind.path.write_bytes(whole)
    assert max(map(len, lines), default=0) < 1000
    assert not any("\n" in line for line in lines)
