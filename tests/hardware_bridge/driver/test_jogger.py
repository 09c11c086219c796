# SPDX-License-Identifier: Apache-2.0
"""One strut by hand, over a real pty."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.driver.jogger import FIRST_MOVE_S, STEP_S, STEP_US, Jogger
from hardware_bridge.errors import BoardSilent, DutyError, PortBusy
from hardware_bridge.link.port_lock import lock_port
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.safety.limits import Limits
from hardware_bridge.saved_state.duty_record import DutyRecord
from hardware_bridge.saved_state.last_pulses import LastPulses
from hardware_bridge.saved_state.robot_identity import Identity
from hardware_bridge.saved_state.robot_records import Records
from tests.hardware_bridge.helpers import Wire, attended, wait_for

BLUE = Identity("blue", "", "lsc")
LIMITS = Limits()


def make(wire: Wire, folder: Path, limits: Limits = LIMITS, silent_board: bool = True, rested_s: float = 1e4) -> Jogger:
    records = Records(folder, BLUE, limits, wire.port)
    try:
        jogger = Jogger(SerialTransport(wire.port), Lsc(), records, limits, silent_board=silent_board, wait=lambda seconds: None)
    finally:
        records.close()
    jogger.rested(rested_s)
    return jogger


@pytest.fixture
def answering() -> Iterator[Wire]:
    """A board that answers, as long as the test lasts."""
    with attended(answers=True) as wire:
        yield wire


def pulses(wire: Wire, count: int) -> list[tuple[int, int]]:
    wait_for(lambda: len(wire.moves()) >= count, f"{count} moves")
    return [(move.channels[0], move.pulses_us[0]) for move in wire.moves()]


def test_a_strut_of_unknown_length_goes_there_once_and_then_in_short_steps(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    assert jogger.pulse_us(3) is None
    assert jogger.go(2, 3, 1500) == 1500
    assert jogger.go(2, 3, 1475) == 1475
    assert pulses(wire, 4) == [(3, 1500), (3, 1490), (3, 1480), (3, 1475)]
    jogger.close()


def test_a_strut_of_known_length_is_energised_where_it_is(wire: Wire, tmp_path: Path) -> None:
    LastPulses(tmp_path, BLUE).save([1, 2], [1620, 1500])
    jogger = make(wire, tmp_path)
    jogger.go(0, 1, 1600)
    assert pulses(wire, 3) == [(1, 1620), (1, 1620 - STEP_US), (1, 1600)]
    jogger.close()


def test_the_bridge_will_know_where_the_struts_are_once_they_are_calibrated(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    jogger.go(0, 1, 1500)
    jogger.go(1, 2, 1420)
    new = Identity("blue", "c1", "lsc")
    assert LastPulses(tmp_path, new).load([1, 2]) == (None, None)
    jogger.becomes("c1")
    jogger.close()
    assert LastPulses(tmp_path, new).load([1, 2, 3]) == (1500, 1420, None)
    assert LastPulses(tmp_path, BLUE).load([1]) == (None,)


def test_the_boards_own_limits_hold(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    assert jogger.go(0, 1, 3000) == 2500
    jogger.close()


def test_a_port_that_a_bridge_holds_is_refused(wire: Wire, tmp_path: Path) -> None:
    first = make(wire, tmp_path)
    with pytest.raises(PortBusy):
        make(wire, tmp_path)
    first.close()


def test_what_is_moved_by_hand_counts_for_the_bridge(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    jogger.go(2, 5, 1500)
    jogger.go(2, 5, 1400)
    jogger.close()
    used_s = DutyRecord(tmp_path, BLUE, LIMITS).load(0.0, 1.0).used_s(0.0, LIMITS.duty_window_s)
    assert used_s == pytest.approx([0.0, 0.0, FIRST_MOVE_S + 10 * STEP_S, 0.0, 0.0, 0.0])


def test_a_strut_that_has_run_enough_is_not_moved_and_the_others_are(wire: Wire, tmp_path: Path) -> None:
    limits = Limits(duty_window_s=30.0)
    jogger = make(wire, tmp_path, limits)
    jogger.go(0, 1, 1500)
    with pytest.raises(
        DutyError, match=r"S1: has run 6\.0 s of the last 30 s and would run 0\.1 s more, the limit is 6 s; wait \d+ s"
    ):
        jogger.go(0, 1, 1700)
    assert jogger.pulse_us(1) == 1600
    assert jogger.go(1, 2, 1500) == 1500
    assert pulses(wire, 12)[-2:] == [(1, 1600), (2, 1500)]
    jogger.close()


def test_actuators_that_nobody_knows_have_run(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path, rested_s=0.0)
    assert not jogger.history_is_known
    with pytest.raises(DutyError, match="nobody knows how long the struts have run"):
        jogger.go(0, 1, 1500)
    jogger.rested(600.0)
    assert jogger.history_is_known
    jogger.go(0, 1, 1500)
    assert pulses(wire, 1) == [(1, 1500)]
    jogger.close()


def test_a_board_that_never_answers_is_not_moved_without_the_word_and_one_that_answers_is(
    wire: Wire, answering: Wire, tmp_path: Path
) -> None:
    with pytest.raises(BoardSilent, match=r"never answered .* if it cannot answer, give --silent-board"):
        make(wire, tmp_path, silent_board=False)
    assert not wire.moves()
    lock_port(wire.port).release()  # it is free again
    jogger = make(answering, tmp_path, silent_board=False)
    jogger.go(0, 1, 1500)
    jogger.close()
