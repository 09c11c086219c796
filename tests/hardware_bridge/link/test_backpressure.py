# SPDX-License-Identifier: Apache-2.0
"""Frames are not sent to queue: the port's count, the board's late answers, and what is told of both."""

from collections.abc import Callable

import pytest

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import LinkLost
from hardware_bridge.link.board_link import LATE_ANSWER_S, PORT_LIMIT_S, Link
from hardware_bridge.prototype_client.fault_client import FROM_BOARD, inject
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.virtual_prototype.boards.registry import emulate
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID, MID_M, wait_for
from tests.hardware_bridge.link.test_board_link import ALL_ON, CHANNELS, CutTransport, Setup


class Slow(CutTransport):
    """A port that says how many bytes it still holds."""

    holds = 0

    def pending_bytes(self) -> int:
        return self.holds


@pytest.fixture
def slow() -> Slow:
    return Slow(emulate("lsc"))


@pytest.fixture
def link(slow: Slow) -> Link:
    link = Link(slow, parse_board("lsc"), CHANNELS, 1.0, 4.0)  # type: ignore[arg-type]
    link.open()
    return link


def test_a_port_that_holds_the_frame_before_gets_no_other_and_at_last_is_lost(slow: Slow, link: Link) -> None:
    assert not link.holds_back(0.0)
    slow.holds = 1000
    assert link.holds_back(1.0)
    assert link.holds_back(1.0 + PORT_LIMIT_S)
    with pytest.raises(LinkLost, match=r"has sent nothing on for 0\.5 s"):
        link.holds_back(1.1 + PORT_LIMIT_S)
    assert link.congested_periods == 3


def test_a_port_that_catches_up_is_forgiven(slow: Slow, link: Link) -> None:
    for second in range(3):
        slow.holds = 1000
        assert link.holds_back(second)
        slow.holds = 0
        assert not link.holds_back(second + 0.4)


def test_a_late_answer_holds_frames_back_until_it_comes(slow: Slow, link: Link) -> None:
    slow.mute = True
    link.attend(0.0, ALL_ON)
    assert not link.holds_back(3.0), "a board that never answered is not late"
    slow.mute = False
    link.attend(3.1, ALL_ON)
    assert link.attend(3.2, ALL_ON) is not None
    slow.mute = True
    link.attend(4.2, ALL_ON)
    assert not link.holds_back(4.2 + LATE_ANSWER_S)
    assert link.holds_back(4.3 + LATE_ANSWER_S)
    link.attend(5.3, ALL_ON)
    assert link.holds_back(5.4), "asking again is no answer"
    slow.mute = False
    link.attend(6.4, ALL_ON)
    assert link.attend(6.5, ALL_ON) is not None
    assert not link.holds_back(6.5)


def test_questions_answers_and_their_time_are_counted() -> None:
    setup = Setup("ssc32")
    for second in range(3):
        assert setup.ask(float(second)) is not None
    setup.transport.mute = True
    assert setup.ask(3.0) is None
    setup.transport.mute = False
    assert setup.ask(4.0) is not None
    replies = setup.link.replies
    assert (replies.questions, replies.unanswered, replies.bad) == (5, 1, 0)
    assert replies.latency.median_s == pytest.approx(0.1)
    setup.link.begin_counting()
    assert setup.link.replies.questions == 0


def test_a_motion_waits_for_a_late_answer_and_then_goes_on(start_prototype: Callable, make_bridge: Callable[..., Bridge]) -> None:
    running = start_prototype(time_scale=1.0)
    bridge = make_bridge(str(running.link), liveness_period_s=0.2)
    bridge.open()
    with armed(bridge) as lease:
        motion = bridge.execute(Trajectory([1.5], [[MID_M + 0.02, *MID[1:]]]), lease)
        inject(running.link, "drop", FROM_BOARD)
        wait_for(lambda: bridge.snapshot().congested_periods >= 5, "frames held back")
        sent = bridge.snapshot().frames_sent
        wait_for(lambda: bridge.snapshot().congested_periods >= 10, "more of them")
        assert bridge.snapshot().frames_sent == sent
        assert motion.result() is None
        inject(running.link, "clear")
        assert motion.wait(20.0)
        assert bridge.snapshot().replies.unanswered > 0
        wait_for(lambda: abs(running.body.lengths_m[0] - MID_M - 0.02) < 1e-6, "the target")


def test_a_boards_errors_are_told_until_reset(start_prototype: Callable, make_bridge: Callable[..., Bridge]) -> None:
    running = start_prototype(board=emulate("maestro"))
    bridge = make_bridge(str(running.link), board=parse_board("maestro"), liveness_period_s=0.05)
    bridge.open()
    with armed(bridge):

        def faulty() -> bool:  # in the middle of a packet the byte is none of its own: once more
            if bridge.snapshot().mode is not Mode.FAULT:
                running.board.receive(b"\x00", running.body.time_s)
            return bridge.snapshot().mode is Mode.FAULT

        wait_for(faulty, "the fault")
    assert bridge.snapshot().board_errors == ("serial protocol",)
    bridge.reset()
    assert bridge.snapshot().board_errors == ()
