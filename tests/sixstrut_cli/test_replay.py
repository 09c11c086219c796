"""Replaying the recorded session that ships with the repository, and sessions that were tampered with."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from hardware_bridge.bag_reader import Session, read_session
from sim_core.model import build_model
from sixstrut_cli.outcomes import outcomes_of
from sixstrut_cli.replaying import ReplayError, events_of, model_of, replay, require_same_model

BAG = Path(__file__).parents[2] / "bags" / "example.mcap"


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
    tries = outcomes_of(session, 0.234)
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
