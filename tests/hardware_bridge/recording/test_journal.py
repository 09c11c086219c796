# SPDX-License-Identifier: Apache-2.0
"""Journals that a crash, a disk or a person damaged: only the damaged place is lost, and a damaged journal is kept."""

import random
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from hardware_bridge.errors import RecorderError
from hardware_bridge.recording import journal as journal_module
from hardware_bridge.recording import journal_repair
from hardware_bridge.recording.bag_reader import read_bag
from hardware_bridge.recording.journal import finish_journal
from hardware_bridge.recording.journal_repair import mend
from hardware_bridge.recording.recorder import Recorder
from tests.hardware_bridge.recording.test_recorder import STRING, recorder, string
from tests.scale import examples

MESSAGES = 700
FRAME = struct.Struct("<BQ")
NOON_NS = 1_780_000_000_000_000_000


def whole_journal(folder: Path) -> bytes:
    """The journal of a session of two topics, as it is when its process is killed."""
    log = recorder(folder / "whole.mcap")
    for number in range(MESSAGES):
        topic = "a" if number % 3 else "b"
        log.write(topic, STRING, string(f"message {number} {'x' * (number % 40)}"), NOON_NS + number * 1_000_000)
    log.sync()
    data = log.journal.read_bytes()
    log.close()
    return data


def without_checks(data: bytes) -> bytes:
    """The same journal as older recorders wrote it."""
    kept = [data[:8]]
    for at, opcode, end in records(data):
        if opcode != 0x80:
            kept.append(data[at:end])
    return b"".join(kept)


def records(data: bytes):
    at = 8
    while at < len(data):
        opcode, length = FRAME.unpack_from(data, at)
        yield at, opcode, at + FRAME.size + length
        at += FRAME.size + length


def nth_message(data: bytes, number: int) -> int:
    return [at for at, opcode, _ in records(data) if opcode == 5][number]


@pytest.fixture(scope="module")
def journals(tmp_path_factory) -> dict[str, bytes]:
    checked = whole_journal(tmp_path_factory.mktemp("journal"))
    return {"checked": checked, "old": without_checks(checked)}


def finish(folder: Path, data: bytes) -> tuple[journal_module.Recording, list[str]]:
    """The recording, and the texts in its log."""
    path = folder / "s.mcap"
    path.unlink(missing_ok=True)
    journal = folder / "s.mcap.journal"
    journal.write_bytes(data)
    recording = finish_journal(journal, path)
    assert not journal.exists()
    texts = [message.data[8:-1].decode() for message in read_bag(path).messages]
    assert len(texts) == recording.messages
    return recording, texts


ALL = [f"message {number} {'x' * (number % 40)}" for number in range(MESSAGES)]


@pytest.mark.parametrize("kind", ["checked", "old"])
def test_zeros_in_the_middle_cost_what_lay_there_and_the_journal_is_kept(tmp_path, journals, kind):
    data = bytearray(journals[kind])
    middle = len(data) // 2
    data[middle : middle + 4096] = bytes(4096)
    recording, texts = finish(tmp_path, bytes(data))
    lost = [text for text in ALL if text not in texts]
    assert texts == [text for text in ALL if text in texts]
    assert 1 <= len(lost) == recording.missing <= 4096 // 60 + 2
    assert ALL[0] in texts
    assert ALL[-1] in texts
    assert 4096 <= recording.unread_bytes < 4096 + 300
    assert recording.unread_places == 1
    assert recording.kept == tmp_path / "s.mcap.journal.damaged"
    assert recording.kept.read_bytes() == bytes(data)
    told = read_bag(recording.path).metadata["recovery"]
    assert told["unread_bytes"] == str(recording.unread_bytes)
    assert told["missing_messages"] == str(recording.missing)
    assert told["checked"] == ("true" if kind == "checked" else "false")


@pytest.mark.parametrize("kind", ["checked", "old"])
@pytest.mark.parametrize("bit", range(3, 32, 4))
def test_one_bit_of_a_records_length_costs_that_record(tmp_path, journals, kind, bit):
    data = bytearray(journals[kind])
    at = nth_message(data, 300) + 1 + bit // 8
    data[at] ^= 1 << bit % 8
    recording, texts = finish(tmp_path, bytes(data))
    assert texts == [text for number, text in enumerate(ALL) if number != 300]
    assert recording.missing == 1
    assert recording.kept is not None


def test_any_bit_costs_one_record_at_most_and_nothing_is_changed_without_a_word(tmp_path, journals):
    rng = random.Random(4)
    for _ in range(60):
        data = bytearray(journals["checked"])
        data[rng.randrange(200, len(data))] ^= 1 << rng.randrange(8)
        recording, texts = finish(tmp_path, bytes(data))
        assert set(texts) <= set(ALL)
        assert len(texts) >= MESSAGES - 1
        if texts != ALL:
            assert recording.kept is not None
        if recording.kept is not None:
            recording.kept.unlink()


@pytest.mark.parametrize("kind", ["checked", "old"])
def test_a_cut_tail_is_no_damage(tmp_path, journals, kind):
    for cut in (1, 20, 40, 60, 90, 5000):
        recording, texts = finish(tmp_path, journals[kind][:-cut])
        assert texts == ALL[: len(texts)]
        assert len(texts) >= MESSAGES - 2 - cut // 60
        assert (recording.unread_bytes, recording.kept, recording.complete) == (0, None, False)
        assert "recovery" not in read_bag(recording.path).metadata


@pytest.mark.parametrize("kind", ["checked", "old"])
def test_a_tail_of_zeros_is_damage(tmp_path, journals, kind):
    recording, texts = finish(tmp_path, journals[kind] + bytes(4096))
    assert texts == ALL
    assert recording.unread_bytes == 4096
    assert recording.kept is not None


def test_a_damaged_journal_never_takes_the_place_of_another_one(tmp_path, journals):
    first, _ = finish(tmp_path, journals["checked"] + bytes(4096))
    second, _ = finish(tmp_path, journals["checked"] + bytes(4097))
    assert first.kept != second.kept
    assert first.kept.exists()
    assert second.kept.exists()


@pytest.mark.parametrize("kind", ["checked", "old"])
def test_an_unknown_channel_is_survived(tmp_path, journals, kind):
    data = journals[kind]
    head = struct.pack("<HIQQ", 999, 1, NOON_NS, NOON_NS)
    stranger = FRAME.pack(5, len(head) + 10) + head + bytes(10)
    recording, texts = finish(tmp_path, data + stranger)
    assert texts == ALL
    assert recording.unread_bytes == len(stranger)
    assert recording.kept is not None


def test_a_topic_whose_declaration_is_damaged_is_declared_again(tmp_path, journals):
    data = bytearray(journals["checked"])
    first = next(at for at, opcode, _ in records(data) if opcode == 4)
    data[first + 20] ^= 1
    recording, texts = finish(tmp_path, bytes(data))
    assert texts == ALL[1:]
    assert recording.kept is not None


def test_a_journal_whose_head_is_damaged_is_found_by_its_marks(tmp_path, journals):
    _, texts = finish(tmp_path, bytes(100) + journals["checked"][100:])
    assert len(texts) > 0


def test_other_readers_read_a_journal_as_it_is(tmp_path):
    log = recorder(tmp_path / "a.mcap")
    for number in range(50):
        log.write("x", STRING, string("a"), number)
    log._queue.put(None)
    log._thread.join()
    finished = tmp_path / "copy.mcap"
    finished.write_bytes(log.journal.read_bytes())
    with finished.open("rb") as stream:
        assert len(list(make_reader(stream).iter_messages())) == 50
    with Reader(finished) as reader:
        assert len(list(reader.messages())) == 50
    assert len(read_bag(finished).messages) == 50
    log.close()


@settings(max_examples=examples(150), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from(["checked", "old"]),
    edits=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=0, max_size=60), st.integers(0, 60)), min_size=1, max_size=4),
)
def test_whatever_is_done_to_a_journal_a_log_or_the_error_comes_of_it(tmp_path, journals, kind, edits):
    data = bytearray(journals[kind][:20_000])
    for where, new, removed in edits:
        at = int(where * len(data))
        data[at : at + removed] = new
    path = tmp_path / "s.mcap"
    journal = tmp_path / "s.mcap.journal"
    journal.write_bytes(bytes(data))
    try:
        recording = finish_journal(journal, path)
    except RecorderError:
        assert journal.exists()
        return
    finally:
        path.unlink(missing_ok=True)
        journal.unlink(missing_ok=True)
    if recording.kept is not None:
        assert recording.kept.read_bytes() == bytes(data)
        recording.kept.unlink()


# ---- in a process of its own ------------------------------------------------------------------------------------------


def left_over(folder: Path, data: bytes) -> tuple[Path, Path]:
    journal = folder / "s.mcap.journal"
    journal.write_bytes(data)
    return journal, folder / "s.mcap"


def test_a_left_over_journal_is_mended_by_a_child(tmp_path, journals):
    journal, path = left_over(tmp_path, journals["checked"])
    assert mend(journal, path) == f"mended {path}: {MESSAGES} messages of a session that was cut short"
    assert not journal.exists()


def test_what_could_not_be_read_is_told(tmp_path, journals):
    journal, path = left_over(tmp_path, journals["checked"] + bytes(4096))
    line = mend(journal, path)
    assert line.startswith(f"mended {path}: {MESSAGES} messages")
    assert "4096 bytes in 1 place(s) are damaged" in line
    assert line.endswith(f"the journal is kept as {journal}.damaged")


def test_a_journal_that_is_none_is_kept_and_told(tmp_path):
    journal, path = left_over(tmp_path, b"\x1b[31mnothing of the kind")
    with pytest.raises(RecorderError, match="is no MCAP file") as caught:
        mend(journal, path)
    assert str(caught.value).isprintable()
    assert journal.exists()


HOSTILE: dict[str, Callable[[], bytes]] = {
    "a child that needs too much memory": lambda: b"x = bytearray(1 << 40)",
    "a child that dies": lambda: b"import os; os.kill(os.getpid(), 11)",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_journal_that_kills_its_reader_kills_nobody_else(tmp_path, journals, what, monkeypatch):
    journal, path = left_over(tmp_path, journals["checked"])
    script = tmp_path / "reader.py"
    limited = b"import resource; resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n"
    script.write_bytes(limited + HOSTILE[what]())
    real = subprocess.Popen
    monkeypatch.setattr(journal_repair.subprocess, "Popen", lambda words, **how: real([sys.executable, str(script)], **how))
    with pytest.raises(RecorderError, match="mending was given up"):
        mend(journal, path)
    assert journal.exists()


@pytest.mark.slow
def test_a_journal_made_of_bombs_ends_within_its_limits(tmp_path):
    """Chunks that unpack to gigabytes, in a file that calls itself a journal: no journal has any, they are not unpacked."""
    import zstandard

    packed = zstandard.compress(bytes(500 << 20), 19)
    body = struct.pack("<QQQII", 0, 1, 500 << 20, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    data = b"\x89MCAP0\r\n" + FRAME.pack(1, len(header)) + header + (FRAME.pack(6, len(body)) + body) * 10
    journal, path = left_over(tmp_path, data)
    line = mend(journal, path)
    assert ": 0 messages" in line
    assert Path(f"{journal}.damaged").read_bytes() == data


def test_the_child_ends_with_its_parent(tmp_path, journals):
    journal, path = left_over(tmp_path, journals["checked"])
    code = (
        "import sys, threading, hardware_bridge.recording.journal_repair as m\n"
        "m.finish_journal = lambda *a: threading.Event().wait()\n"
        "sys.exit(m.main(sys.argv[1:]))"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(journal), str(path)], stdin=subprocess.PIPE) as child:
        assert child.stdin is not None
        child.stdin.close()
        assert child.wait(30.0) == 3


def test_a_recorder_seals_every_record(tmp_path):
    log = Recorder(tmp_path / "a.mcap", lambda name: "string data\n")
    log.write("x", STRING, string("a"), 1)
    log.sync()
    kinds = [opcode for _, opcode, _ in records(log.journal.read_bytes())]
    log.close()
    assert kinds == [1, 0x80, 3, 4, 5, 0x80]
