# SPDX-License-Identifier: Apache-2.0
"""Which bridge is alive: its states are stamped now, and everything of another session is ignored while it speaks."""

import pytest
from builtin_interfaces.msg import Time

from sim_core.twin.live_bridge import FRESH_S, SILENT_S, STRANGE_S, LiveBridge
from tensegrity_interfaces.msg import BridgeState, FaceObservation, StrutsSent

NOW_S = 1_800_000_000


class Listener:
    """With clocks that a test moves."""

    def __init__(self):
        self.told, self.taken, self.adopted = [], [], 0
        self.clock_s = 0.0
        self.live = LiveBridge(self.told.append, self._count, lambda: self.clock_s)

    def _count(self):
        self.adopted += 1

    def hears(self, session, age_s=0.0):
        stamp_ns = round((NOW_S + self.clock_s - age_s) * 1e9)
        state = BridgeState(session=session)
        state.header.stamp = Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self.live.hears(state, round((NOW_S + self.clock_s) * 1e9))

    def sees(self, face, session):
        self.live.takes(FaceObservation(face=face, session=session), lambda event: self.taken.append(event.face))


@pytest.fixture
def listener():
    return Listener()


def test_the_first_fresh_state_tells_who_is_alive(listener):
    assert listener.hears("a")
    listener.sees("TC6", "a")
    assert (listener.live.session, listener.taken, listener.adopted) == ("a", ["TC6"], 1)


@pytest.mark.parametrize("age_s", [FRESH_S + 0.1, 86_400.0, -FRESH_S - 0.1])
def test_a_recorded_state_is_nobodys(listener, age_s):
    assert not listener.hears("old", age_s)
    assert listener.live.session is None
    assert len(listener.told) == 1


def test_a_recording_beside_a_live_bridge_is_ignored_with_one_warning(listener):
    listener.hears("a")
    for _ in range(100):
        listener.clock_s += 0.1
        assert listener.hears("a")
        assert not listener.hears("old", 600.0)
        listener.sees("TO5", "old")
    assert listener.taken == []
    assert listener.live.session == "a"
    assert len(listener.told) == 1


def test_a_second_living_bridge_is_ignored_while_the_first_speaks(listener):
    listener.hears("a")
    while listener.clock_s < 3 * STRANGE_S:
        listener.clock_s += 0.25
        assert listener.hears("a")
        assert not listener.hears("b")
    assert len(listener.told) == 1
    assert "b" in listener.told[0]


def test_a_bridge_that_starts_again_is_followed_once_the_old_one_is_silent(listener):
    listener.hears("a")
    listener.clock_s = SILENT_S + 0.1
    listener.sees("TO5", "b")  # events come before the state
    assert listener.taken == []
    assert listener.hears("b")
    assert (listener.taken, listener.adopted, listener.told) == (["TO5"], 2, [])


def test_a_bridge_that_gets_its_port_is_followed_at_once(listener):
    assert listener.hears("")
    listener.clock_s += 0.1
    assert listener.hears("a")
    assert (listener.live.session, listener.told) == ("a", [])
    listener.clock_s += 0.1
    assert not listener.hears(""), "another bridge, without a port"


def test_faces_that_came_before_any_state_are_not_lost(listener):
    listener.sees("TC1", "old")
    listener.sees("TC6", "a")
    listener.hears("a")
    assert listener.taken == ["TC6"]


def test_a_face_waits_however_many_heartbeats_come_after_it(listener):
    listener.sees("TC6", "a")
    heard = []
    for seq in range(1000):
        listener.live.takes(StrutsSent(seq=seq, session="a"), heard.append)
    listener.hears("a")
    assert listener.taken == ["TC6"]
    assert [event.seq for event in heard] == list(range(900, 1000))


def test_what_waits_is_bounded(listener):
    for number in range(10_000):
        listener.sees("TC1", f"s{number}")
    listener.hears("s1")
    assert listener.taken == []
