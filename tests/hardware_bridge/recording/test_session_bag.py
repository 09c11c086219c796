# SPDX-License-Identifier: Apache-2.0
"""Bags: names, early messages, sessions cut short; which observations are news."""

import os
import time
from pathlib import Path
from shutil import rmtree

import pytest
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

from hardware_bridge.errors import BagError, RecorderError
from hardware_bridge.recording import session_bag
from hardware_bridge.recording.bag_on_disk import bags_in, is_bag_folder, journals_in, whole_bag
from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.session_bag import SessionLog, bag_folder, make_bag, mend_journals
from sim_core.files.yaml_reader import read_yaml
from tensegrity_robot.ros.event_filters import EventTimes, ObservationFilter

NOON = time.struct_time((2026, 3, 1, 12, 0, 0, 6, 60, 0))
STRING = "std_msgs/msg/String"


def text(value: str) -> bytes:
    return bytes(serialize_message(String(data=value)))


def opened(folder: Path) -> SessionLog:
    log = SessionLog(pytest.fail)
    log.write("/early", STRING, text("before"), 1)
    log.open(folder, {"/early": (STRING, False)}, {"library.yaml": b"x"}, {"port": "p"})
    return log


def test_bags_are_named_by_the_second_and_never_overwrite(tmp_path):
    bags = tmp_path / "new" / "bags"
    assert make_bag(bags, NOON) == bags / "session_20260301_120000"
    assert make_bag(bags, NOON).name == "session_20260301_120000_2"
    (bags / "session_20260301_120000_3.mcap").touch()  # as older bridges wrote them
    (bags / "session_20260301_120000_4.mcap.journal").touch()
    assert make_bag(bags, NOON).name == "session_20260301_120000_5"


def test_the_bag_folder_is_configured_or_from_the_environment_or_below_here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SIXSTRUT_BAGS", raising=False)
    assert bag_folder("") == tmp_path / "bags"
    monkeypatch.setenv("SIXSTRUT_BAGS", str(tmp_path / "mine"))
    assert bag_folder("") == tmp_path / "mine"
    assert bag_folder("other") == tmp_path / "other"


def test_messages_from_before_the_bag_are_in_it(tmp_path):
    log = opened(tmp_path)
    log.write("/early", STRING, text("after"), 2)
    log.close()
    assert log.path is not None
    session = read_session(log.path)
    assert [message.data for message in session.of("early")] == ["before", "after"]
    assert session.attachments == {"library.yaml": b"x"}
    assert session.metadata["session"] == {"port": "p"}
    assert "python" in session.metadata["versions"]


def test_what_comes_after_the_end_is_dropped(tmp_path):
    log = opened(tmp_path)
    log.close()
    log.write("/early", STRING, text("late"), 3)
    log.close()


def test_a_dead_session_is_mended_and_a_living_one_left_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(session_bag, "YOUNG_S", 0.0)
    living = opened(tmp_path)
    assert mend_journals(tmp_path) == []
    living.close()
    assert living.path is not None
    journal = dead_session(tmp_path)
    (line,) = mend_journals(tmp_path)
    assert line == f"mended {tmp_path / 'dead.mcap'}: 1 messages of a session that was cut short"
    assert not journal.exists()
    assert [message.data for message in read_session(tmp_path / "dead.mcap").of("early")] == ["before"]


def dead_session(folder: Path, of_its_own: bool = False) -> Path:
    """The journal that a killed bridge leaves: older ones beside the bags, newer ones in a folder of its own."""
    log = opened(folder)
    log._recorder.sync()
    data = log._recorder.journal.read_bytes()
    log.close()
    rmtree(log.path)
    journal = folder / "dead" / "dead.mcap.journal" if of_its_own else folder / "dead.mcap.journal"
    journal.parent.mkdir(exist_ok=True)
    journal.write_bytes(data)
    return journal


def told_by_rosbags(bag: Path) -> tuple[int, int, int, dict[str, int]]:
    with Reader(bag) as reader:
        return reader.start_time, reader.duration, reader.message_count, {c.topic: c.msgcount for c in reader.connections}


def test_a_bag_is_a_folder_that_rosbag2_opens(tmp_path):
    """Its metadata.yaml has the fields of rosbag2's yaml.hpp (version 9, Jazzy), in their order; rosbags reads it, too."""
    log = SessionLog(pytest.fail)
    log.open(tmp_path, {"/latched": (STRING, True), "/silent": (STRING, False)}, {}, {})
    for at_ns in (5_000_000_000, 7_000_000_000):
        log.write("/latched", STRING, text("x"), at_ns)
    assert not is_bag_folder(log.path)
    with pytest.raises(BagError, match=r"session_\w+ is of a session that lives or was cut short: the bridge makes a bag of it"):
        read_session(log.path)
    log.close()
    name = f"{log.path.name}.mcap"
    assert sorted(path.name for path in log.path.iterdir()) == ["metadata.yaml", name]
    told = read_yaml(log.path / "metadata.yaml")["rosbag2_bagfile_information"]
    span = {"starting_time": {"nanoseconds_since_epoch": 5_000_000_000}, "duration": {"nanoseconds": 2_000_000_000}}
    topics = told.pop("topics_with_message_count")
    assert told == {
        "version": 9,
        "storage_identifier": "mcap",
        **span,
        "message_count": 2,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [name],
        "files": [{"path": name, **span, "message_count": 2}],
        "custom_data": {},
        "ros_distro": told["ros_distro"],
    }
    assert [topic["message_count"] for topic in topics] == [2, 0]
    latched = topics[0]["topic_metadata"]
    assert list(latched) == ["name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash"]
    assert (latched["name"], latched["type"], latched["serialization_format"]) == ("/recorded/latched", STRING, "cdr")
    assert latched["type_description_hash"].startswith("RIHS01_")
    (offered,) = latched["offered_qos_profiles"]
    assert (offered["durability"], offered["deadline"]) == ("transient_local", {"sec": 9223372036, "nsec": 854775807})
    assert told_by_rosbags(log.path) == (5_000_000_000, 2_000_000_001, 2, {"/recorded/latched": 2, "/recorded/silent": 0})
    for given in (log.path, log.path / name):
        assert [message.data for message in read_session(given).of("latched")] == ["x", "x"]
        assert whole_bag(given) == log.path
    (log.path / "metadata.yaml").unlink()
    assert len(list(read_session(log.path).of("latched"))) == 2, "the bag is still one without it"


def test_a_dead_session_of_its_own_folder_becomes_such_a_bag(tmp_path, monkeypatch):
    monkeypatch.setattr(session_bag, "YOUNG_S", 0.0)
    journal = dead_session(tmp_path, of_its_own=True)
    foreign = tmp_path / "saved" / "dead.mcap.journal"
    foreign.parent.mkdir()
    foreign.write_bytes(journal.read_bytes())
    assert journals_in(tmp_path) == [journal], "what somebody put away is left alone"
    (line,) = mend_journals(tmp_path)
    assert "dead.mcap: 1 messages of a session that was cut short" in line
    assert told_by_rosbags(tmp_path / "dead")[2] == 1
    assert bags_in(tmp_path) == [tmp_path / "dead"]
    assert sorted(path.name for path in (tmp_path / "dead").iterdir()) == ["dead.mcap", "metadata.yaml"]


def test_foreign_qualities_of_service_keep_no_bag_from_being_finished(tmp_path):
    log = SessionLog(pytest.fail)
    log.open(tmp_path, {}, {}, {})
    number = log._recorder._writer.register_channel("/odd", "cdr", 0, {"offered_qos_profiles": "{a: ["})
    log._recorder._writer.add_message(number, 1, b"", 1)
    log.close()
    told = read_yaml(log.path / "metadata.yaml")["rosbag2_bagfile_information"]["topics_with_message_count"]
    assert told[0]["topic_metadata"]["offered_qos_profiles"] == []


def test_a_damaged_session_is_mended_kept_and_told(tmp_path, monkeypatch):
    monkeypatch.setattr(session_bag, "YOUNG_S", 0.0)
    journal = dead_session(tmp_path)
    journal.write_bytes(journal.read_bytes() + bytes(4096))
    (line,) = mend_journals(tmp_path)
    assert "1 messages" in line
    assert "4096 bytes in 1 place(s) are damaged" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dead.mcap", "dead.mcap.journal.damaged"]
    assert mend_journals(tmp_path) == []


def test_a_journal_from_the_future_is_not_waited_for(tmp_path, monkeypatch):
    waited: list[float] = []
    journal = dead_session(tmp_path)
    monkeypatch.setattr(session_bag.time, "sleep", waited.append)
    monkeypatch.setattr(session_bag, "mend", lambda journal, path: "mended")
    ahead = time.time() + 7200.0
    os.utime(journal, (ahead, ahead))
    assert mend_journals(tmp_path) == ["mended"]
    assert waited == [session_bag.YOUNG_S]


def test_no_bag_begins_while_the_clock_is_at_its_beginning(tmp_path, monkeypatch):
    monkeypatch.setattr(session_bag.time, "time", lambda: 12_345.0)
    monkeypatch.setattr(session_bag.time, "gmtime", lambda: time.struct_time((1970, 1, 1, 3, 25, 45, 3, 1, 0)))
    with pytest.raises(RecorderError, match=r"the computer's clock says 1970-01-01: set it \(timedatectl\), or do without a log"):
        opened(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_observation_is_news_when_face_or_rest_changes():
    news = ObservationFilter()
    assert news.is_news("TC6", True)
    assert not news.is_news("TC6", True)
    assert news.is_news("TC6", False)
    assert news.is_news(None, False)
    assert not news.is_news(None, False)
    assert news.is_news("TO5", True)


def test_rest_after_a_write_is_news_even_on_the_same_face():
    news = ObservationFilter()
    news.is_news("TC6", True)
    news.moved()
    assert news.is_news("TC6", True)
    assert not news.is_news("TC6", True)


def test_an_event_is_known_by_number_and_time_and_old_ones_are_forgotten():
    times = EventTimes()
    for seq in range(1, EventTimes.MOST + 2):
        times.add(seq, 50 * seq)
    assert times.has(2, 100)
    assert not times.has(2, 101)
    assert not times.has(1, 50)
