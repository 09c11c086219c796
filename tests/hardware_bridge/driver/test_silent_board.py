# SPDX-License-Identifier: Apache-2.0
"""A board that can answer and never has is not armed without the operator's word."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from hardware_bridge.boards.lsc import CMD_BATTERY
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import BoardSilent, FaultLatched, NotClear
from hardware_bridge.link.board_link import FIRST_ANSWER_LIMIT_S
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.virtual_prototype.boards.registry import emulate
from tests.hardware_bridge.boards.test_registry import SPECS
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID, Wire, attended, wait_for
from tests.scale import few

Make = Callable[..., Bridge]


@pytest.fixture
def answering() -> Iterator[Wire]:
    """A board that can be told to answer, as long as the test lasts."""
    with attended(answers=False) as wire:
        yield wire


def bytes_of(wire: Wire) -> bytes:
    data = b""
    try:
        while more := os.read(wire._near, 65536):
            data += more
    except BlockingIOError:
        return data
    return data


@pytest.mark.parametrize("spec", few(SPECS, 3))
def test_a_silent_board_is_not_armed_and_gets_nothing_but_queries(make_bridge: Make, rules: Rules, wire: Wire, spec: str) -> None:
    board = parse_board(spec)
    bridge = make_bridge(wire.port, board=board, silent_board=False)
    bridge.open()
    began_s = time.monotonic()
    with pytest.raises(
        BoardSilent, match=r"has never answered on .* if it cannot answer, start the bridge with silent_board:=true"
    ) as caught:
        bridge.arm("test", True, MID)
    assert time.monotonic() - began_s > 1.0, "it was given time for a first answer"
    assert ("each of its kind answers" in str(caught.value)) == (spec != "lsc")
    with pytest.raises(BoardSilent):
        bridge.arm("test", True, MID)
    assert time.monotonic() - began_s < FIRST_ANSWER_LIMIT_S + 5.0, "but not for ever"
    snapshot = bridge.snapshot()
    assert (snapshot.mode, snapshot.answered, snapshot.frames_sent) == (Mode.DISARMED, False, 0)
    bridge.close()
    query = board.encode_query(rules.calibration.channels).data
    sent = bytes_of(wire)
    assert sent == query * (len(sent) // len(query))


@pytest.mark.parametrize("spec", SPECS)
def test_a_board_that_answers_is_armed_as_soon_as_it_has(start_prototype: Callable, make_bridge: Make, spec: str) -> None:
    running = start_prototype(time_scale=4.0, board=emulate(spec))
    bridge = make_bridge(str(running.link), board=parse_board(spec), silent_board=False, liveness_period_s=30.0)
    bridge.open()
    with armed(bridge):
        assert bridge.snapshot().answered, "asked at once, and not only after a period"


def test_arm_waits_for_a_first_answer_that_is_late(make_bridge: Make, answering: Wire) -> None:
    bridge = make_bridge(answering.port, silent_board=False, liveness_period_s=0.2)
    bridge.open()
    asked = threading.Thread(target=lambda: bridge.arm("test", True, MID))
    asked.start()
    wait_for(lambda: bool([frame for frame in answering.frames if frame.command == CMD_BATTERY]), "a question")
    answering.answers = True
    asked.join()
    assert bridge.snapshot().lease_holder == "test"


def test_the_operators_word_arms_a_board_that_cannot_answer(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port, silent_board=True)
    bridge.open()
    began_s = time.monotonic()
    with armed(bridge):
        assert not bridge.snapshot().answered
    assert time.monotonic() - began_s < FIRST_ANSWER_LIMIT_S + 5.0


def test_who_asks_nothing_hears_nothing(make_bridge: Make, answering: Wire) -> None:
    answering.answers = True
    bridge = make_bridge(answering.port, silent_board=False, liveness_period_s=None)
    bridge.open()
    with pytest.raises(BoardSilent, match="it is asked nothing"):
        bridge.arm("test", True, MID)


def test_each_opening_needs_an_answer_of_its_own(make_bridge: Make, answering: Wire) -> None:
    answering.answers = True
    bridge = make_bridge(answering.port, silent_board=False, liveness_period_s=0.05, liveness_limit_s=0.3)
    bridge.open()
    with armed(bridge):
        answering.answers = False
        wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "the lost link")
    bridge.reset()
    with pytest.raises(BoardSilent):
        bridge.arm("test", True, MID)
    answering.answers = True
    wait_for(lambda: bridge.snapshot().answered, "an answer")
    with armed(bridge):
        pass


def test_what_else_is_wrong_is_said_first(make_bridge: Make, wire: Wire) -> None:
    bridge = make_bridge(wire.port, silent_board=False)
    bridge.open()
    with pytest.raises(NotClear):
        bridge.arm("test", False, MID)
    bridge.stop()
    with pytest.raises(FaultLatched):
        bridge.arm("test", True, MID)


def test_stop_does_not_wait_for_an_arm_that_waits_for_an_answer(make_bridge: Make, rules: Rules, answering: Wire) -> None:
    bridge = make_bridge(answering.port, rules=replace(rules), silent_board=False, liveness_period_s=0.1)
    bridge.open()
    refused: list[Exception] = []

    def arm() -> None:
        try:
            bridge.arm("test", True, MID)
        except FaultLatched as error:
            refused.append(error)

    asked = threading.Thread(target=arm)
    asked.start()
    wait_for(lambda: bool(answering.frames), "a question")
    bridge.stop()
    answering.answers = True
    asked.join()
    assert refused
    assert not answering.moves()
