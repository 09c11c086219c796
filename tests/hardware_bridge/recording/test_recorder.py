# SPDX-License-Identifier: Apache-2.0
"""Logs, written here and read back with two readers that are not ours: rosbags and mcap_ros2."""

import threading
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import DecodedMessageTuple, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from hardware_bridge.errors import RecorderError, SchemaError
from hardware_bridge.recording import journal as journal_module
from hardware_bridge.recording.journal import finish_journal
from hardware_bridge.recording.recorder import Recorder, recorded_topic
from tests.hardware_bridge.helpers import wait_for
from tests.hardware_bridge.killing import kill_while_writing
from tests.hardware_bridge.recording.test_message_definitions import SCHEMAS

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS, STRING = "sensor_msgs/msg/JointState", "std_msgs/msg/String"


def joint_state(number: int) -> bytes:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=number, nanosec=7)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="odom")
    message = types[JOINTS](
        header=header, name=["S1", "S2"], position=np.array([0.1, number]), velocity=np.array([]), effort=np.array([])
    )
    return bytes(STORE.serialize_cdr(message, JOINTS))


def string(text: str) -> bytes:
    return bytes(STORE.serialize_cdr(STORE.types[STRING](data=text), STRING))


def decoded(path: Path) -> list[DecodedMessageTuple]:
    """All messages as mcap_ros2 reads them, by the log's own schemas."""
    with path.open("rb") as stream:
        return list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())


def recorder(path: Path, **options: object) -> Recorder:
    return Recorder(path, SCHEMAS.schema_text, type_hash=SCHEMAS.type_hash, **options)  # type: ignore[arg-type]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of a thousand joint states and ten strings."""
    path = tmp_path / "session.mcap"
    with_strings = recorder(path)
    with_strings.add_topic("/bridge/face", STRING, transient_local=True)
    with_strings.add_metadata("software", {"version": "0.1.0", "hash": "abc"})
    with_strings.add_attachment("calibration.yaml", b"struts: {}\n")
    for number in range(1000):
        with_strings.write("bridge/joint_states", JOINTS, joint_state(number), 1000 + number)
        if number % 100 == 0:
            with_strings.write("/bridge/face", STRING, string(f"face {number}"), 1000 + number)
    recording = with_strings.close()
    assert recording.messages == 1010
    assert recording.counts == {"/recorded/bridge/joint_states": 1000, "/recorded/bridge/face": 10}
    assert recording.complete
    return path


def test_rosbags_reads_every_message(log: Path) -> None:
    with Reader(log) as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        assert set(topics) == {"/recorded/bridge/joint_states", "/recorded/bridge/face"}
        assert topics["/recorded/bridge/face"].msgtype == STRING
        (qos,) = topics["/recorded/bridge/face"].ext.offered_qos_profiles
        assert (qos.durability.name, qos.depth, qos.reliability.name) == ("TRANSIENT_LOCAL", 10, "RELIABLE")
        (qos,) = topics["/recorded/bridge/joint_states"].ext.offered_qos_profiles
        assert (qos.durability.name, qos.depth) == ("VOLATILE", 10)
        seen = list(reader.messages())
    assert len(seen) == 1010
    assert [time_ns for _, time_ns, _ in seen] == sorted(time_ns for _, time_ns, _ in seen)
    joints = [STORE.deserialize_cdr(data, JOINTS) for connection, _, data in seen if connection.msgtype == JOINTS]
    assert [message.header.stamp.sec for message in joints] == list(range(1000))


def test_mcap_ros2_reads_every_message_from_the_logs_own_schemas(log: Path) -> None:
    read = decoded(log)
    assert len(read) == 1010
    joints = [each for each in read if each.channel.topic == "/recorded/bridge/joint_states"]
    assert [each.decoded_message.position[1] for each in joints] == list(range(1000))
    assert [each.message.sequence for each in joints] == list(range(1, 1001))
    assert (joints[0].message.log_time, joints[0].message.publish_time) == (1000, 1000)


def test_the_log_is_indexed_compressed_and_carries_its_configuration(log: Path) -> None:
    with log.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert reader.get_header().profile == "ros2"
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        for channel in summary.channels.values():
            assert channel.message_encoding == "cdr"
            assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        assert [(each.name, each.metadata["hash"]) for each in reader.iter_metadata()] == [("software", "abc")]
        assert [(each.name, each.data) for each in reader.iter_attachments()] == [("calibration.yaml", b"struts: {}\n")]


def test_only_the_log_is_left(log: Path) -> None:
    assert [path.name for path in log.parent.iterdir()] == ["session.mcap"]


def test_no_live_name_is_recorded() -> None:
    assert recorded_topic("bridge/state") == recorded_topic("/bridge/state") == "/recorded/bridge/state"


def test_an_empty_session_is_a_log(tmp_path: Path) -> None:
    assert recorder(tmp_path / "a.mcap").close().messages == 0
    assert decoded(tmp_path / "a.mcap") == []


def test_closing_twice_gives_the_same_and_writing_then_raises(tmp_path: Path) -> None:
    log = recorder(tmp_path / "a.mcap")
    log.write("x", STRING, string("a"), 1)
    assert log.close() is log.close()
    with pytest.raises(RecorderError, match="is closed"):
        log.write("x", STRING, string("b"), 2)
    assert log.messages_lost == 1


def test_no_log_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    alive = recorder(path)
    with pytest.raises(RecorderError, match=r"journal .* exists"):
        recorder(path)
    alive.close()
    with pytest.raises(RecorderError, match="never overwritten"):
        recorder(path)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecorderError, match="choose another folder"):
        recorder(tmp_path / "none" / "a.mcap")


def test_an_unknown_type_is_refused_and_the_log_goes_on(tmp_path: Path) -> None:
    log = recorder(tmp_path / "a.mcap")
    with pytest.raises(SchemaError):
        log.write("x", "nobody/msg/Knows", b"", 1)
    log.write("x", STRING, string("a"), 1)
    with pytest.raises(RecorderError, match="cannot also be"):
        log.write("x", JOINTS, joint_state(1), 2)
    assert log.close().messages == 1


def test_many_threads_lose_nothing(tmp_path: Path) -> None:
    log = recorder(tmp_path / "a.mcap")

    def work(name: str) -> None:
        for number in range(500):
            log.write(name, STRING, string(str(number)), number)

    threads = [threading.Thread(target=work, args=(f"topic_{index}",)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(log.close().counts.values()) == {500}
    for each in decoded(tmp_path / "a.mcap"):
        assert each.decoded_message.data == str(each.message.sequence - 1)


def test_a_full_queue_is_a_latched_and_counted_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faults: list[str] = []
    release, held = threading.Event(), threading.Event()
    write_item = Recorder._write_item

    def slow(self: Recorder, *arguments: object) -> None:
        held.set()
        release.wait(20.0)
        write_item(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Recorder, "_write_item", slow)
    log = recorder(tmp_path / "a.mcap", queue_size=5, on_fault=faults.append)
    log.add_topic("x", STRING)
    assert held.wait(20.0)
    for number in range(5):
        log.write("x", STRING, string("a"), number)
    for _ in range(3):
        with pytest.raises(RecorderError, match="wait for the disk"):
            log.write("x", STRING, string("late"), 9)
    assert log.messages_lost == 3
    assert len(faults) == 1
    assert (log.waiting, log.most_waiting) == (5, 5)
    release.set()
    assert log.close().messages == 5
    assert (log.waiting, log.most_waiting) == (0, 5)


def test_a_failing_disk_is_a_fault_and_what_was_acknowledged_is_kept(tmp_path: Path) -> None:
    faults: list[str] = []
    log = recorder(tmp_path / "a.mcap", on_fault=faults.append)
    for number in range(20):
        log.write("x", STRING, string("a"), number)
    log.sync()
    assert log.messages_written == 20
    real = log._stream.flush

    def full() -> None:
        raise OSError(28, "No space left on device")

    log._stream.flush = full  # type: ignore[method-assign]
    log.write("x", STRING, string("lost"), 21)
    wait_for(lambda: bool(faults), "the fault")
    assert "No space left on device" in log.fault
    with pytest.raises(RecorderError, match="No space left"):
        log.write("x", STRING, string("b"), 22)
    log._stream.flush = real  # type: ignore[method-assign]
    assert log.messages_lost == 2
    assert log.close().messages >= 20


def test_sync_says_when_the_disk_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    release = threading.Event()
    monkeypatch.setattr("hardware_bridge.recording.recorder.os.fsync", lambda descriptor: release.wait(20.0))
    log = recorder(tmp_path / "a.mcap")
    with pytest.raises(RecorderError, match="did not take it"):
        log.sync(0.05)
    release.set()
    log.close()


def test_a_log_that_does_not_read_back_keeps_its_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = recorder(tmp_path / "a.mcap")
    log.write("x", STRING, string("a"), 1)
    monkeypatch.setattr(journal_module, "_summary", lambda path: None)
    with pytest.raises(RecorderError, match="does not read back"):
        log.close()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap.journal"]
    monkeypatch.undo()
    assert log.close().messages == 1


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.journal").write_bytes(b"nothing of the kind")
    with pytest.raises(RecorderError, match="is no MCAP file"):
        finish_journal(tmp_path / "a.mcap.journal", tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap.journal").exists()


@pytest.mark.parametrize("cut", [1, 7, 40, 100, 140])
def test_a_journal_with_a_cut_tail_gives_every_whole_message(tmp_path: Path, cut: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def give_up(journal: Path, path: Path) -> None:
        raise RecorderError(str(path), "killed")

    monkeypatch.setattr("hardware_bridge.recording.recorder.finish_journal", give_up)
    monkeypatch.setattr("hardware_bridge.recording.recorder.Writer.finish", lambda self: None)
    log = recorder(tmp_path / "a.mcap")
    for number in range(50):
        log.write("x", STRING, string("a" * 30), number)
    with pytest.raises(RecorderError, match="killed"):
        log.close()
    monkeypatch.undo()
    with log.journal.open("r+b") as stream:
        stream.truncate(log.journal.stat().st_size - cut)
    recording = finish_journal(log.journal, log.path)
    assert not recording.complete
    assert recording.messages == (50 if cut < 33 else 49 if cut < 136 else 48)  # 33 bytes are the check, 70 the message
    assert (recording.unread_bytes, recording.kept) == (0, None)
    assert len(decoded(log.path)) == recording.messages


@pytest.mark.parametrize("seed", range(4))
def test_killed_while_writing_no_acknowledged_message_is_lost(tmp_path: Path, seed: int) -> None:
    left = kill_while_writing(tmp_path, seed)
    assert len(left.by_mcap) >= left.acknowledged > 0
    assert left.by_mcap == left.by_rosbags == list(range(len(left.by_mcap)))


def test_writing_never_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    release = threading.Event()
    write_item = Recorder._write_item

    def slow(self: Recorder, *arguments: object) -> None:
        release.wait(20.0)
        write_item(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Recorder, "_write_item", slow)
    log = recorder(tmp_path / "a.mcap")
    for number in range(1000):
        log.write("x", STRING, string("a"), number)
    assert log.messages_written == 0
    release.set()
    assert log.close().messages == 1000
