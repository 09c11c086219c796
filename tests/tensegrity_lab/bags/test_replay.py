# SPDX-License-Identifier: Apache-2.0
"""Replaying the recorded session that ships with the repository, and sessions that were tampered with."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_reader import Session, read_session
from sim_core.dynamics.model import build_model
from sim_core.errors import SimError
from tensegrity_lab.bags.replay import ReplayError, events_of, model_of, replay, require_same_model
from tensegrity_lab.bags.roll_attempts import attempts_of
from tensegrity_lab.bags.trial_replay import library_of

BAG = Path(__file__).parents[3] / "bags" / "example"


@pytest.fixture(scope="module")
def session():
    return read_session(BAG)


@pytest.fixture(scope="module")
def replayed(session):
    return replay(session)


def test_the_example_has_the_live_twins_bits_and_ends_on_the_recorded_face(replayed):
    assert replayed.live_states > 50
    assert replayed.same_states == replayed.live_states
    assert replayed.final == replayed.recorded
    assert len({check.observed for check in replayed.faces}) >= 4


def test_the_same_bag_twice_gives_the_same_bits(session, replayed):
    again = replay(session)
    assert (again.digest, again.step) == (replayed.digest, replayed.step)


def test_another_model_is_not_compared_bit_by_bit_but_its_faces_are(session, replayed):
    nominal = model_of(session)
    heavier = build_model(replace(nominal.prototype, box_mass_kg=nominal.prototype.box_mass_kg * 1.05))
    other = replay(session, heavier)
    assert other.live_states == 0
    assert other.digest != replayed.digest
    assert other.faces


def test_a_tampered_command_is_noticed_at_its_event(session, replayed):
    sent = session.messages["bridge/struts_sent"]
    # a last frame, which the struts reach: in mid-motion they are still on their way, and a little more changes nothing
    last = max(i for i, recorded in enumerate(sent) if not recorded.message.heartbeat and i < len(sent) - 20)
    original = sent[last].message
    lengths = [value + 1e-4 for value in original.length_m]
    forged = SimpleNamespace(seq=original.seq, robot_time_ns=original.robot_time_ns, length_m=lengths, header=original.header)
    messages = {
        **session.messages,
        "bridge/struts_sent": [*sent[:last], sent[last]._replace(message=forged), *sent[last + 1 :]],
    }
    result = replay(Session(session.path, messages, session.attachments, session.metadata))
    assert result.same_states < result.live_states
    assert result.first_difference >= original.seq


def test_events_come_in_the_order_of_their_numbers(session):
    numbers = [event.seq for event in events_of(session)]
    assert numbers == sorted(set(numbers))


def test_a_bag_without_commands_is_refused(session):
    with pytest.raises(ReplayError, match="holds no sent commands"):
        replay(Session(session.path))


def test_tries_and_outcomes_are_read_from_what_was_asked_and_seen(session):
    tries = attempts_of(session, 0.234)
    assert len(tries) == 3
    assert [tries[0].source, *(t.returned for t in tries)] == [check.observed for check in replay(session).faces]
    assert all(t.succeeded(t.returned) for t in tries)
    assert all(any(t.policy) for t in tries)


def test_a_bag_of_another_model_is_refused_with_both_hashes(session):
    require_same_model(session, model_of(session))
    nominal = model_of(session)
    heavier = build_model(replace(nominal.prototype, box_mass_kg=nominal.prototype.box_mass_kg * 1.05))
    with pytest.raises(ReplayError) as caught:
        require_same_model(session, heavier)
    assert nominal.hash in str(caught.value)
    assert heavier.hash in str(caught.value)


FORGED = {
    "in 146 years": ({"robot_time_ns": 2**62}, "robot time 4.612e+09 s is impossible"),
    "in an hour": ({"robot_time_ns": 3600 * 10**9}, "robot time jumps by"),
    "before the beginning": ({"robot_time_ns": -1}, "robot time -1e-09 s is impossible"),
    "a huge number": ({"seq": 2**64 - 1}, "jumps by"),
    "not a number": ({"length_m": [float("nan")] * 6}, "a length of nan m of S1 is impossible"),
    "a robot like a tower": ({"length_m": [1e300] * 6}, "a length of 1e+300 m of S1 is impossible"),
}


@pytest.mark.parametrize("case", FORGED)
def test_a_forged_event_is_refused_in_one_line_and_never_stepped_to(session, case):
    change, told = FORGED[case]
    sent = session.messages["bridge/struts_sent"]
    fields = ("seq", "robot_time_ns", "length_m", "heartbeat", "header")
    forged = SimpleNamespace(**{**{name: getattr(sent[100].message, name) for name in fields}, **change})
    messages = {**session.messages, "bridge/struts_sent": [*sent[:100], sent[100]._replace(message=forged), *sent[101:]]}
    with pytest.raises(ReplayError, match=re.escape(told)):
        replay(Session(session.path, messages, session.attachments, session.metadata))


def test_log_times_that_were_forged_as_well_buy_no_eternity(session):
    sent = session.messages["bridge/struts_sent"]
    fields = ("seq", "length_m", "heartbeat", "header")
    late = []
    for number, recorded in enumerate(sent[:40]):
        forged = SimpleNamespace(robot_time_ns=number * 10**15, **{name: getattr(recorded.message, name) for name in fields})
        late.append(recorded._replace(message=forged, log_time_ns=number * 10**18))
    with pytest.raises(ReplayError, match=r"nothing was told for 11\.6 days"):
        replay(Session(session.path, {"bridge/struts_sent": late}, session.attachments, session.metadata))


def test_a_goal_that_is_none_is_one_line(session):
    asked = session.messages["bridge/asked"]
    for change in ({"points": []}, {"joint_names": ["S1"]}):
        old = asked[0].message
        forged = SimpleNamespace(**{"header": old.header, "joint_names": old.joint_names, "points": old.points, **change})
        with pytest.raises(BagError, match="is no lengths of S1 to S6"):
            attempts_of(Session(session.path, {"bridge/asked": [asked[0]._replace(message=forged)]}), 0.234)


@pytest.mark.parametrize("name", ["prototype.yaml", "library.yaml"])
def test_a_bag_with_hostile_yaml_is_one_short_line(session, name):
    laughs = b"a: &a [x, x]\nb: &b [*a, *a]\n"
    hostile = Session(session.path, session.messages, {**session.attachments, name: laughs}, session.metadata)
    with pytest.raises(SimError) as caught:
        model_of(hostile) if name == "prototype.yaml" else library_of(hostile)
    assert f"example: {name} is not valid YAML at line 1: an anchor" in str(caught.value)
