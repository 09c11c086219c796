"""One stream from two topics."""

from __future__ import annotations

import pytest

from sim_core.follow import Observed, Sent
from tensegrity_robot.event_stream import Begin, EventStream

S = 1_000_000_000


def sent(seq: int) -> Sent:
    return Sent(seq, seq * 50_000_000, (0.234,) * 6)


def seen(seq: int, face: str | None = "TC6", settled: bool = True) -> Observed:
    return Observed(seq, seq * 50_000_000, face, settled)


class Bridge:
    """Events of one bridge that began at a wall time (s), as they arrive at a stream."""

    def __init__(self, stream: EventStream, began_s: float = 100.0):
        self._stream, self._began_ns = stream, round(began_s * S)

    def sends(self, seq: int) -> list:
        return self._stream.sent(sent(seq), self._stamp_ns(seq))

    def tells(self, seq: int, face: str | None = "TC6", settled: bool = True) -> list:
        return self._stream.observed(seen(seq, face, settled), self._stamp_ns(seq))

    def _stamp_ns(self, seq: int) -> int:
        return self._began_ns + seq * 50_000_000


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
    assert stream.sent(late, 200 * S) == []
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
