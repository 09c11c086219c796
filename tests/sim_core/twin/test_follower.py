# SPDX-License-Identifier: Apache-2.0
import random

import numpy as np
import pytest

from sim_core.dynamics.actuators import following, load_actuators
from sim_core.dynamics.model import build_model
from sim_core.gaits.library import load_library
from sim_core.structure.policy import lengths_of, neutral_lengths
from sim_core.twin.follower import AT_REST, IN_MOTION, SLICE_S, Follower, Observed, Order, Pace, Sent

MS = 1_000_000
S = 1000 * MS


def stream(model, policy, seconds=8.0, seen=()):
    """A bridge's event stream: neutral for half a second, then the policy; `seen` are (time s, face, settled)."""
    lengths = tuple(lengths_of(model.prototype, policy))
    neutral = tuple(neutral_lengths(model.prototype))
    timed = [(t, lengths if t >= 500 * MS else neutral) for t in range(0, int(seconds * 1000) * MS, 50 * MS)]
    timed += [(int(t * 1000) * MS + 1, (face, settled)) for t, face, settled in seen]
    timed.sort(key=lambda item: item[0])
    return [Observed(seq, t, *what) if len(what) == 2 else Sent(seq, t, what) for seq, (t, what) in enumerate(timed, start=40)]


def followed(model, events, face="TC6", rule=IN_MOTION):
    follower = Follower(model, face, rule=rule)
    for event in events:
        follower.apply(event)
    return follower


@pytest.fixture(scope="module")
def policy():
    return load_library("robust").gaits("TC6", "TO5")[0].policy


def test_the_same_stream_gives_the_same_bits(model, policy):
    events = stream(model, policy)
    one, other = followed(model, events), followed(model, events)
    assert one.digest() == other.digest()
    assert (one.first_seq, one.last_seq) == (40, events[-1].seq)
    assert one.robot.footing().face == "TO5"


def test_repeating_what_was_sent_changes_no_bit(model, policy):
    events = stream(model, policy)
    changes = [e for i, e in enumerate(events) if i == 0 or e.lengths_m != events[i - 1].lengths_m]
    assert len(changes) == 2
    assert followed(model, [*changes, events[-1]]).digest() == followed(model, events).digest()


def test_an_agreeing_observation_changes_nothing_but_its_number(model, policy):
    plain = followed(model, stream(model, policy))
    seen = followed(model, stream(model, policy, seen=[(0.2, "TC6", True), (7.5, "TO5", True)]))
    assert seen.resets == 0
    assert seen.digest() == plain.digest()


def test_a_contradicting_observation_puts_the_twin_where_the_robot_is(model, policy):
    events = stream(model, policy, seen=[(7.5, "TC3", True)])
    follower = followed(model, events)
    assert follower.resets == 1
    assert follower.robot.footing().face == "TC3"
    assert follower.step == events[-1].robot_time_ns * model.steps_per_second // 10**9 - events[0].robot_time_ns
    assert followed(model, events).digest() == follower.digest()


def test_by_the_first_rule_an_unsettled_observation_is_not_acted_upon(model, policy):
    seen = followed(model, stream(model, policy, seen=[(4.0, "TC3", False)]), rule=AT_REST)
    assert seen.resets == 0
    assert seen.digest() == followed(model, stream(model, policy), rule=AT_REST).digest()


def test_in_motion_the_twin_has_half_a_second_to_come_onto_the_face_by_itself(model, policy):
    plain = followed(model, stream(model, policy))
    lands_s = next(
        t / 1000
        for t in range(1000, 8000, 50)
        if followed(model, stream(model, policy, seconds=t / 1000)).robot.footing().face == "TO5"
    )
    soon = followed(model, stream(model, policy, seen=[(lands_s - 0.3, "TO5", False)]))
    assert soon.resets == 0
    assert soon.digest() == plain.digest()
    early = followed(model, stream(model, policy, seconds=lands_s, seen=[(lands_s - 1.0, "TO5", False)]))
    assert early.resets == 1


def test_in_motion_it_is_put_onto_the_face_with_the_lengths_that_its_struts_have(model, policy):
    events = stream(model, policy, seconds=2.2, seen=[(1.6, "TO5", False)])
    before = followed(model, [e for e in events if isinstance(e, Sent)])
    assert before.robot.footing().face != "TO5"
    lengths_m = before.robot.rest_lengths_m()
    seen = followed(model, events)
    assert (seen.robot.footing().face, seen.resets) == ("TO5", 1)
    assert np.abs(seen.robot.rest_lengths_m() - lengths_m).max() < 0.002
    assert np.array_equal(seen.robot.targets_m(), followed(model, events, rule=AT_REST).robot.targets_m())
    assert followed(model, events).digest() == seen.digest()


def test_an_observation_waits_until_the_twin_itself_is_at_rest(model, policy):
    """Seen settled on the target while the twin is still on its way there: no reset."""
    moving = followed(model, stream(model, policy, seen=[(1.5, "TO5", True)]))
    assert moving.resets == 0
    assert moving.robot.footing().face == "TO5"


def test_order_gives_events_out_by_number_however_they_arrive():
    events = [Sent(n, n * MS, (0.234,) * 6) for n in range(1, 101)]
    order, out = Order(), []
    shuffled = events[1:]
    random.Random(4).shuffle(shuffled)
    for event in [events[0], *shuffled, *events[3:5]]:
        out += order.add(event)
    assert out == events
    assert order.lost == 0


def test_order_gives_up_on_an_event_that_never_comes():
    order, out = Order(patience=5), []
    for n in (1, 2, *range(4, 20)):
        out += order.add(Sent(n, n * MS, (0.234,) * 6))
    assert [event.seq for event in out] == [1, 2, *range(4, 20)]
    assert order.lost == 1


def test_actuators_that_feel_their_load_lag_behind_and_do_not_heed_how_events_cut_the_time(prototype, policy):
    parameters = load_actuators()
    quick = build_model(following(prototype, parameters))
    events = stream(quick, policy)
    changes = [event for i, event in enumerate(events) if i == 0 or event.lengths_m != events[i - 1].lengths_m]
    loaded, cut, ideal = (Follower(quick, "TC6", p) for p in (parameters, parameters, None))
    apart = 0.0
    for event in events:
        loaded.apply(event)
        ideal.apply(event)
        apart = max(apart, float(np.abs(loaded.robot.rest_lengths_m() - ideal.robot.rest_lengths_m()).max()))
    for event in (*changes, events[-1]):
        cut.apply(event)
    assert apart > 0.002
    assert cut.digest() == loaded.digest()
    assert loaded.identity.startswith(f"{quick.hash}-")
    assert ideal.identity == quick.hash
    assert loaded.robot.footing().face == "TO5"


def test_a_long_pause_is_stepped_in_slices_to_the_same_bits(model, policy):
    events = stream(model, policy, seconds=3.0)
    later = Sent(events[-1].seq + 1, events[-1].robot_time_ns + 30 * S, events[-1].lengths_m)
    whole = followed(model, [*events, later])
    sliced = followed(model, events)
    steps = [sliced.step]
    while not sliced.approach(later):
        steps.append(sliced.step)
    sliced.apply(later)
    assert max(np.diff(steps)) <= SLICE_S * model.steps_per_second
    assert len(steps) >= 15
    assert (sliced.digest(), sliced.step) == (whole.digest(), whole.step)


def test_a_pace_lets_a_stream_wait_sleep_and_come_in_bursts_but_not_jump():
    pace = Pace()
    beat = [Sent(seq, seq * 50 * MS, (0.234,) * 6) for seq in range(1, 10_000)]
    assert not any(pace.refuses(event, 0) for event in beat)  # all that waited, at once
    assert "jumps by" in pace.refuses(Sent(10_000, 10_000 * S, (0.234,) * 6), 0)
    assert pace.refuses(Sent(10_000, 500 * S, (0.234,) * 6), 0) == ""
    assert pace.refuses(Sent(82_000, 4100 * S, (0.234,) * 6), 3600 * S) == ""  # an hour of sleep
    assert "the number of event" in pace.refuses(Sent(2**64 - 1, 4101 * S, (0.234,) * 6), 3601 * S)
    assert pace.refuses(Sent(82_020, 4101 * S, (0.234,) * 6), 3601 * S) == ""


def test_many_small_jumps_are_no_way_around_the_pace():
    pace = Pace()
    refused = [bool(pace.refuses(Sent(seq, seq * 100 * S, (0.234,) * 6), seq)) for seq in range(1, 100)]
    assert refused.count(False) <= 8
