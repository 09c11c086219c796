"""One strut by hand, over a real pty."""

from __future__ import annotations

from pathlib import Path

import pytest

from hardware_bridge.codecs.lsc import Lsc
from hardware_bridge.errors import PortBusy
from hardware_bridge.jogger import STEP_US, Jogger
from hardware_bridge.last_pulses import LastPulses
from hardware_bridge.transport import SerialTransport
from tests.hardware_bridge.helpers import Wire, wait_for


def make(wire: Wire, folder: Path) -> Jogger:
    return Jogger(SerialTransport(wire.port), Lsc(), LastPulses(folder, wire.port), wait=lambda seconds: None)


def pulses(wire: Wire, count: int) -> list[tuple[int, int]]:
    wait_for(lambda: len(wire.moves()) >= count, f"{count} moves")
    return [(move.channels[0], move.pulses_us[0]) for move in wire.moves()]


def test_a_strut_of_unknown_length_goes_there_once_and_then_in_short_steps(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    assert jogger.pulse_us(3) is None
    assert jogger.go(3, 1500) == 1500
    assert jogger.go(3, 1475) == 1475
    assert pulses(wire, 4) == [(3, 1500), (3, 1490), (3, 1480), (3, 1475)]
    jogger.close()


def test_a_strut_of_known_length_is_energised_where_it_is(wire: Wire, tmp_path: Path) -> None:
    LastPulses(tmp_path, wire.port).save([1, 2], [1620, 1500])
    jogger = make(wire, tmp_path)
    jogger.go(1, 1600)
    assert pulses(wire, 3) == [(1, 1620), (1, 1620 - STEP_US), (1, 1600)]
    jogger.close()


def test_the_bridge_will_know_where_the_struts_are(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    jogger.go(1, 1500)
    jogger.go(2, 1420)
    jogger.close()
    assert LastPulses(tmp_path, wire.port).load([1, 2, 3]) == (1500, 1420, None)


def test_the_boards_own_limits_hold(wire: Wire, tmp_path: Path) -> None:
    jogger = make(wire, tmp_path)
    assert jogger.go(1, 3000) == 2500
    jogger.close()


def test_a_port_that_a_bridge_holds_is_refused(wire: Wire, tmp_path: Path) -> None:
    first = make(wire, tmp_path)
    with pytest.raises(PortBusy):
        make(wire, tmp_path)
    first.close()
