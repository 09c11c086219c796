# SPDX-License-Identifier: Apache-2.0
"""`sixstrut odds`: rehearsals in bags against what then happened."""

import io
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_on_disk import file_of
from hardware_bridge.recording.bag_reader import read_session, seconds_of
from sim_core.dynamics.model import build_model
from sim_core.structure.parameters import load_prototype
from tensegrity_lab.bags import rehearsed_rolls, trial_replay
from tensegrity_lab.bags.rehearsed_rolls import bags_of, foretold_in
from tensegrity_lab.bags.replay import events_of
from tensegrity_lab.bags.trial_replay import trials_of
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome, utc_text
from tensegrity_lab.studies.fit_trials import read_tries
from tests.hardware_bridge.recording.test_bag_reader import folder
from tests.sixstrut_cli.test_commands import sixstrut

BAG = Path(__file__).parents[3] / "bags" / "example"


@pytest.mark.slow
def test_the_example_s_rolls_were_foretold_and_came(tmp_path):
    picture = tmp_path / "odds.png"
    result = sixstrut("odds", str(BAG), "--picture", str(picture), "--json")
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    rehearsals = list(read_session(BAG).of("rehearsal"))
    assert [(r["source"], r["target"], r["odds"]) for r in told["rolls"]] == [
        (m.source_face, m.gaits[0].target_face, m.gaits[0].odds) for m in rehearsals
    ]
    assert told["observed"] == sum(r["won"] for r in told["rolls"]) / len(rehearsals)
    assert picture.read_bytes().startswith(b"\x89PNG")


def recorded_by_rosbag2(path: Path, without: tuple[str, ...] = (), facts: dict[str, str] | None = None) -> Path:
    """The example as rosbag2 records it beside the live stack: live names, nothing attached, in two files.

    `facts`: what a bridge says of its session, if that recorded it.
    """
    rows = list(make_reader(io.BytesIO(file_of(BAG).read_bytes())).iter_messages())
    rows = [row for row in rows if not row[1].topic.endswith(without or "\n")]
    path.parent.mkdir(exist_ok=True)
    folder(path, ["rec_0.mcap", "rec_1.mcap"])
    for number, part in enumerate((rows[: len(rows) // 2], rows[len(rows) // 2 :])):
        with (path / f"rec_{number}.mcap").open("wb") as stream:
            writer, channels = Writer(stream), {}
            writer.start("ros2", "rosbag2")
            if facts is not None:
                writer.add_metadata("session", facts)
            for schema, channel, message in part:
                if channel.topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    live = channel.topic.replace("/recorded/", "/")
                    channels[channel.topic] = writer.register_channel(live, channel.message_encoding, kind)
                writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
            writer.finish()
    return path


def test_what_rosbag2_records_of_the_live_stack_is_a_bag_as_ours(tmp_path):
    recorded = recorded_by_rosbag2(tmp_path / "bags" / "rosbag")
    assert bags_of([recorded.parent]) == bags_of([recorded]) == [recorded]
    own = recorded.parent.parent / "own"
    folder(own, ["own.mcap"])
    (own / "own.mcap").write_bytes(file_of(BAG).read_bytes())
    assert bags_of([own / "own.mcap", own]) == [own], "a bag counts once, however it is named"
    with pytest.raises(SessionError, match="is given twice"):
        read_tries([own, own / "own.mcap"], build_model(load_prototype()))
    assert foretold_in(recorded) == [found._replace(bag="rosbag") for found in foretold_in(BAG)]
    model = build_model(load_prototype())
    assert read_tries([recorded], model).seen == read_tries([BAG], model).seen
    ours, theirs = read_session(BAG), read_session(recorded)
    assert events_of(theirs) == events_of(ours)
    with pytest.raises(SessionError, match="holds no trials"):
        trials_of(recorded)


@pytest.mark.parametrize("topic", ["bridge/asked", "bridge/face", "rehearsal"])
def test_a_topic_that_rosbag2_was_not_told_to_record_is_named(tmp_path, topic):
    recorded = recorded_by_rosbag2(tmp_path / "bags" / "rosbag", without=(topic,))
    with pytest.raises(BagError, match=f"holds no message of topic {topic}: record it too"):
        foretold_in(recorded)


def test_a_session_of_the_bridge_in_which_nothing_was_rehearsed_is_no_fault(tmp_path):
    bag = recorded_by_rosbag2(tmp_path / "bags" / "own", without=("rehearsal",), facts={"model": ""})
    assert foretold_in(bag) == []


def test_a_roll_that_ended_elsewhere_failed_and_one_without_a_rehearsal_does_not_count(monkeypatch):
    session = read_session(BAG)
    rehearsed = session.messages["rehearsal"]
    rehearsed.pop(1)
    returning = max(seconds_of(m.header.stamp) for m in session.of("bridge/asked"))
    for message in session.of("bridge/face"):
        if seconds_of(message.header.stamp) > returning:
            message.face = "TC1"
    monkeypatch.setattr(rehearsed_rolls, "read_session", lambda path, topics: session)
    found = foretold_in(BAG)
    assert len(found) == 2
    assert [one.won for one in found] == [True, False]
    assert found[-1].ended == "TC1"


def test_chains_are_left_out_and_said_to_be(monkeypatch):
    session = read_session(BAG)
    first = next(iter(session.of("rehearsal")))
    first.gaits[0].target_face = "TC3"
    assert first.source_face.startswith("TC")
    monkeypatch.setattr(rehearsed_rolls, "read_session", lambda path, topics: session)
    assert [one.is_chain for one in foretold_in(BAG)] == [True, False, False]


def test_void_trials_do_not_count(monkeypatch):
    all_of_them = foretold_in(BAG)
    tries = rehearsed_rolls.attempts_of(read_session(BAG), 0.234)
    facts = dict.fromkeys(("recorded", "session", "experimenter", "robot", "library", "library_hash", "primitive"), "")
    line = Line(
        event=Event.TRIAL, number=1, **facts, virtual_robot=True, roll_class="", source="", target="", repeat=1, proper=True,
        policy_mm=(), odds=1.0, predicted=True, outcome=Outcome.VOID, began=utc_text(round(1e9 * (tries[1].began_s - 0.2))),
    )  # fmt: skip
    monkeypatch.setattr(rehearsed_rolls, "lines_in_bag", lambda path: [line])
    assert foretold_in(BAG) == [all_of_them[0], all_of_them[2]]
    success = replace(line, outcome=Outcome.SUCCESS)
    monkeypatch.setattr(rehearsed_rolls, "lines_in_bag", lambda path: [success])
    assert foretold_in(BAG) == all_of_them


def test_a_folder_without_bags_is_refused(tmp_path):
    with pytest.raises(BagError, match="holds no bag"):
        bags_of([tmp_path])
    (tmp_path / "bags").mkdir()
    (tmp_path / "bags" / "a.mcap").touch()
    assert bags_of([tmp_path, tmp_path / "bags" / "a.mcap"]) == [tmp_path / "bags" / "a.mcap"]


def test_the_trials_of_a_bag_are_found_by_its_folder_by_its_file_and_as_older_bridges_wrote_it(tmp_path, monkeypatch):
    """One that was killed before it was recorded is in a later bag beside it."""
    lines = {}

    def bag(name: str, **recorded: str) -> Path:
        folder(tmp_path / name, [f"{name}.mcap"])
        (tmp_path / name / f"{name}.mcap").touch()
        lines[tmp_path / name] = recorded
        return tmp_path / name

    def lines_of(path: Path) -> list[Any]:
        told = lines[path].items()
        return [SimpleNamespace(event=Event.TRIAL, number=int(number[1:]), bag=of) for number, of in told]

    first, second, old = bag("a", n1="a"), bag("b", n2="a", n3="b", n5="old.mcap"), tmp_path / "old.mcap"
    old.touch()
    lines[old] = {"n4": "old.mcap"}
    monkeypatch.setattr(trial_replay, "lines_in_bag", lines_of)
    for given, numbers in ((first, [1, 2]), (first / "a.mcap", [1, 2]), (second, [3]), (old, [4, 5])):
        assert [line.number for line in trials_of(given)] == numbers
