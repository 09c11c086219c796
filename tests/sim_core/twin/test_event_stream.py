# SPDX-License-Identifier: Apache-2.0
"""One stream from two topics."""

import pytest

from sim_core.twin.event_stream import Arrival, Begin, EventStream
from sim_core.twin.follower import Observed, Sent

S = 1_000_000_000


def sent(seq: int) -> Sent:
    return Sent(seq, seq * 50_000_000, (0.234,) * 6)


def seen(seq: int, face: str | None = "TC6", settled: bool = True) -> Observed:
    return Observed(seq, seq * 50_000_000, face, settled)


class Bridge:
    """Events of one bridge that began at a wall time (s), as they arrive at a stream."""

    def __init__(self, stream: EventStream, began_s: float = 100.0, session: str = "", recorded_s: float = 0.0):
        """`recorded_s`: they are played from a recording that is so old."""
        self._stream, self._began_ns, self._session = stream, round(began_s * S), session
        self._age_ns = round(recorded_s * S)

    def sends(self, seq: int) -> list:
        return self._stream.sent(sent(seq), self.arrival(seq))

    def tells(self, seq: int, face: str | None = "TC6", settled: bool = True) -> list:
        return self._stream.observed(seen(seq, face, settled), self.arrival(seq))

    def arrival(self, seq: int) -> Arrival:
        now_ns = self._began_ns + seq * 50_000_000
        return Arrival(self._session, now_ns - self._age_ns, now_ns, now_ns)


@pytest.fixture
def stream() -> EventStream:
    return EventStream(patience=5)


@pytest.fixture
def bridge(stream) -> Bridge:
    return Bridge(stream)


def test_a_stream_waits_for_the_face_on_which_the_robot_stood_before_it(stream, bridge):
    assert bridge.sends(40) == []
    assert bridge.tells(3, "TC6") == []
    assert bridge.sends(41) == []
    assert bridge.tells(7, "TO5") == []
    assert stream.waiting
    assert stream.begin() == [Begin("TO5"), sent(40), sent(41)]
    assert not stream.waiting
    assert stream.begin() == []
    assert bridge.sends(42) == [sent(42)]


def test_a_stream_that_nobody_watches_begins_when_told(stream, bridge):
    bridge.sends(1)
    assert stream.begin() == [Begin(None), sent(1)]


def test_a_face_from_after_the_first_write_begins_the_stream(bridge):
    bridge.tells(3, "TC6")
    bridge.sends(40)
    assert bridge.tells(41, "TO5") == [Begin("TC6"), sent(40), seen(41, "TO5")]


def test_being_on_no_face_is_not_a_face_to_begin_on(stream, bridge):
    bridge.tells(3, "TC6")
    bridge.tells(9, None, settled=False)
    bridge.sends(40)
    assert stream.begin()[0] == Begin("TC6")


def test_a_face_of_the_past_that_comes_very_late_begins_the_stream_again(stream, bridge):
    bridge.sends(40)
    stream.begin()
    assert bridge.tells(7, "TO5") == [Begin("TO5")]
    assert bridge.tells(7, "TO5") == []
    assert bridge.sends(41) == [sent(41)]


def test_events_of_the_two_topics_are_put_back_into_order(stream, bridge):
    bridge.sends(1)
    assert bridge.tells(4) == [Begin(None), sent(1)]
    assert bridge.sends(2) == [sent(2)]
    assert bridge.sends(3) == [sent(3), seen(4)]
    assert bridge.sends(6) == []
    assert bridge.tells(5) == [seen(5), sent(6)]
    assert stream.lost == 0


@pytest.fixture
def restarted(stream, bridge) -> Bridge:
    """A bridge that takes the place of one that lived for a hundred events and saw a face early on."""
    bridge.sends(1)
    bridge.tells(2)
    for seq in range(3, 101):
        assert bridge.sends(seq) == [sent(seq)]
    return Bridge(stream, began_s=110.0)


def test_a_bridge_that_starts_again_begins_a_new_stream(stream, restarted):
    assert restarted.sends(1) == []
    assert restarted.tells(2, "TO7") == [Begin(None), sent(1), seen(2, "TO7")]
    assert restarted.sends(3) == [sent(3)]
    assert stream.lost == 0


def test_a_new_bridge_may_be_heard_by_its_faces_first(stream, restarted):
    assert restarted.tells(1, "TO7") == []
    assert restarted.tells(9, "TO8") == []
    assert restarted.sends(8) == [Begin("TO7"), sent(8), seen(9, "TO8")]
    assert restarted.sends(10) == [sent(10)]
    assert stream.lost == 0


def test_a_new_bridge_that_is_heard_late_is_told_by_its_robot_time(stream, bridge):
    bridge.sends(1)
    stream.begin()
    bridge.sends(2)
    late = Sent(30, 20_000_000, (0.234,) * 6)
    assert stream.sent(late, Arrival("", 200 * S, 200 * S, 200 * S)) == []
    assert stream.begin() == [Begin(None), late]


def test_another_bridge_that_was_found_begins_a_new_stream_whatever_its_numbers(stream, restarted):
    stream.renew()
    assert restarted.tells(150, "TO7") == []
    assert restarted.sends(160) == []
    assert stream.begin() == [Begin("TO7"), sent(160)]
    assert restarted.sends(161) == [sent(161)]
    assert stream.lost == 0


def test_what_never_comes_is_given_up_and_counted(stream, bridge):
    bridge.sends(1)
    stream.begin()
    given = [event for seq in range(3, 9) for event in bridge.sends(seq)]
    assert given == [sent(seq) for seq in range(3, 9)]
    assert stream.lost == 1


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def named(told) -> EventStream:
    return EventStream(patience=5, warn=told.append)


def follow(bridge: Bridge, stream: EventStream, until: int = 100) -> None:
    bridge.sends(1)
    bridge.tells(2)
    for seq in range(3, until + 1):
        assert bridge.sends(seq) == [sent(seq)]


def test_a_recording_that_is_played_beside_a_living_bridge_is_ignored_with_one_warning(named, told):
    live = Bridge(named, session="live")
    played = Bridge(named, began_s=100.0, session="of May", recorded_s=3600.0)
    follow(live, named)
    for seq in range(101, 200):
        assert played.sends(seq) == []
        assert played.tells(seq, "TC1") == []
        assert live.sends(seq) == [sent(seq)]
    assert (named.session, named.strangers, named.lost) == ("live", 99, 0)
    (line,) = told
    assert "of May" in line
    assert "live" in line


def test_a_living_bridge_wins_over_a_recording_at_once(named):
    played = Bridge(named, session="of May", recorded_s=3600.0)
    follow(played, named)
    live = Bridge(named, began_s=104.9, session="live")
    live.tells(1, "TO7")
    live.sends(2)
    assert named.session == "live"
    assert named.begin() == [Begin("TO7"), sent(2)]
    assert played.sends(101) == []


def test_without_a_living_bridge_a_recording_drives_the_twin(named):
    follow(Bridge(named, session="of May", recorded_s=3600.0), named)
    assert named.session == "of May"


def test_a_bridge_that_starts_again_is_followed_once_the_old_one_is_silent_and_its_faces_are_not_lost(named, told):
    old = Bridge(named, session="old")
    follow(old, named)  # until 105.0 s
    new = Bridge(named, began_s=105.0, session="new")
    assert new.tells(1, "TO7") == []
    for seq in range(2, 41):
        assert new.sends(seq) == []  # two seconds
    assert new.sends(41) == []
    assert named.session == "new"
    assert named.begin() == [Begin("TO7"), sent(41)]
    assert new.sends(42) == [sent(42)]
    assert old.sends(150) == []


def test_a_bridge_that_was_found_alone_is_followed_at_once(named):
    follow(Bridge(named, session="old"), named)
    named.renew()
    new = Bridge(named, began_s=105.0, session="new")
    new.sends(1)
    assert named.begin() == [Begin(None), sent(1)]


def test_a_connection_that_comes_back_goes_on_with_the_same_session(named):
    bridge = Bridge(named, session="live")
    follow(bridge, named)
    named.renew()
    assert bridge.sends(101) == [sent(101)]


LENGTHS = (0.234,) * 6
FORGED = {
    "in 146 years": Sent(101, 2**62, LENGTHS),
    "in an hour": Sent(101, 3600 * S, LENGTHS),
    "before the beginning": Sent(101, -1, LENGTHS),
    "a huge number": Sent(2**64 - 1, 101 * 50_000_000, LENGTHS),
    "number nought": Sent(0, 101 * 50_000_000, LENGTHS),
    "back in time": Sent(101, 1, LENGTHS),
    "not a number": Sent(101, 101 * 50_000_000, (*LENGTHS[:5], float("nan"))),
    "endless": Sent(101, 101 * 50_000_000, (*LENGTHS[:5], float("inf"))),
    "as long as the universe": Sent(101, 101 * 50_000_000, (1e300, *LENGTHS[:5])),
    "a face in 146 years": Observed(101, 2**62, "TC1", True),
    "a face with a huge number": Observed(2**63, 101 * 50_000_000, "TC1", True),
}


@pytest.mark.parametrize(
    ("case", "session"),
    [(case, session) for case in FORGED for session in ("live", "") if session or case != "back in time"],  # a bridge started again
)
def test_an_impossible_event_is_refused_counted_and_told_once_and_the_stream_goes_on(named, told, case, session):
    bridge, forged = Bridge(named, session=session), FORGED[case]
    follow(bridge, named)
    take = named.observed if isinstance(forged, Observed) else named.sent
    for _ in range(300):
        assert take(forged, bridge.arrival(101)) == []
    assert named.refused == 300
    assert len(told) == 1
    assert [event for seq in range(101, 400) for event in bridge.sends(seq)] == [sent(seq) for seq in range(101, 400)]
    assert named.lost == 0


def test_an_impossible_face_that_comes_before_the_stream_is_not_in_it(named):
    bridge = Bridge(named, session="live")
    bridge.sends(1)
    forged = Observed(2**63, 10 * 86_400 * S, "TC1", True)
    assert named.observed(forged, bridge.arrival(1)) == [Begin(None), sent(1)]
    assert [event for seq in range(2, 300) for event in bridge.sends(seq)] == [sent(seq) for seq in range(2, 300)]


@pytest.mark.parametrize("pause_s", [60.0, 3600.0, 86_400.0])
def test_a_twin_that_slept_goes_on_where_the_robot_is(named, pause_s):
    bridge = Bridge(named, session="live")
    follow(bridge, named)
    later = 100 + round(pause_s / 0.05)
    missed = [event for seq in range(later, later + 6) for event in bridge.sends(seq)]
    assert missed == [sent(seq) for seq in range(later, later + 6)]
    assert named.refused == 0


def test_what_never_fitted_begins_a_stream_of_its_own_once_nothing_else_comes(named):
    bridge = Bridge(named, session="live")
    follow(bridge, named)
    forged = Sent(102, 5000 * S, LENGTHS)
    assert named.sent(forged, bridge.arrival(101)) == []
    assert named.sent(forged, bridge.arrival(150)) == []
    assert named.begin() == [Begin(None), forged]


def test_what_waits_is_bounded(named):
    bridge = Bridge(named, session="live")
    for seq in range(1, 1000):
        bridge.tells(seq)
    bridge.sends(5000)
    for number in range(100_000):
        named.sent(Sent(5001 + number, 5000 * 50_000_000 + number, LENGTHS), bridge.arrival(5000))
    assert len(named.begin()) <= 20_100
