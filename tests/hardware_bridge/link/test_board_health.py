# SPDX-License-Identifier: Apache-2.0
import pytest

from hardware_bridge.boards.board import Health
from hardware_bridge.link.board_health import Answer, Verdict, judge

ON, OFF = (True,) * 6, (False,) * 6
GIVEN: tuple[float | None, ...] = (1500.0,) * 6
LOST: tuple[float | None, ...] = (1500.0, None, *GIVEN[2:])


def answer(errors: tuple[str, ...] = (), pulses: tuple[float | None, ...] = GIVEN, energised: tuple[bool, ...] = ON) -> Answer:
    return Answer(Health(None, errors, pulses), energised)


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("good", [answer(), answer(pulses=LOST, energised=OFF), answer(pulses=()), answer(energised=())])
def test_nothing_follows_from_a_good_answer(good: Answer, holds: bool) -> None:
    assert judge(good, holds, True) == Verdict()


def test_a_strut_that_holds_without_a_pulse_is_named_and_its_position_unknown() -> None:
    verdict = judge(answer(pulses=LOST), True, False)
    assert verdict == Verdict("the board gives S2 no pulse any more (reset or brown-out)", True)


@pytest.mark.parametrize("error_moves", [True, False])
def test_an_error_while_struts_hold_is_a_fault(error_moves: bool) -> None:
    verdict = judge(answer(("serial CRC", "serial time-out")), True, error_moves)
    assert verdict == Verdict("the board reports serial CRC, serial time-out", error_moves)


@pytest.mark.parametrize("error_moves", [True, False])
def test_an_error_while_nothing_holds_is_old_news(error_moves: bool) -> None:
    assert judge(answer(("serial time-out",), energised=OFF), False, error_moves) == Verdict("", error_moves)
