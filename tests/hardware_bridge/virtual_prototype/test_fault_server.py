# SPDX-License-Identifier: Apache-2.0
"""The faults that a virtual prototype can be told to have: on its line, its board, its supply and its struts."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import LinkLost, PrototypeError
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.prototype_client.fault_client import FROM_BOARD, TO_BOARD, check_fault, inject
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.virtual_prototype.line_faults import Direction
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID_M, read_exactly, wait_for

FRAME = bytes(range(25))


def test_a_line_without_faults_gives_what_it_gets() -> None:
    line = Direction()
    line.put(FRAME, 1.0)
    assert line.take(1.0) == FRAME
    assert line.take(2.0) == b""


def test_bytes_get_lost_change_come_late_or_from_nobody() -> None:
    line = Direction()
    line.drop = 5
    line.put(FRAME, 0.0)
    assert line.take(0.0) == FRAME[5:]
    line.corrupt = 1
    line.put(FRAME, 0.0)
    changed = line.take(0.0)
    assert changed[0] != FRAME[0]
    assert changed[1:] == FRAME[1:]
    line.delay_s = 0.5
    line.put(FRAME, 1.0)
    assert line.take(1.4) == b""
    assert line.take(1.5) == FRAME
    line.clear()
    line.extra(3, 2.0)
    assert len(line.take(2.0)) == 3


def test_a_cut_waits_for_a_move_and_spares_the_next() -> None:
    line = Direction()
    line.cut = True
    for data, out in ((b"ask?", b"ask?"), (FRAME, FRAME[:12]), (FRAME, FRAME)):
        line.put(data, 0.0)
        assert line.take(0.0) == out


def test_all_bytes_are_lost_until_clear_and_late_ones_then_come() -> None:
    line = Direction()
    line.delay_s = 10.0
    line.put(b"late", 0.0)
    line.drop = math.inf
    line.put(FRAME, 0.0)
    line.clear()
    line.put(b"new", 0.0)
    assert line.take(0.0) == b"latenew"


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ([], r"fault is \[\], valid: drop"),
        ({"fault": "explode"}, "fault is 'explode', valid: drop"),
        ({"fault": "drop"}, "direction of drop is '', valid: to_board, from_board"),
        ({"fault": "reset", "direction": "to_board"}, "direction of reset is 'to_board', valid: none"),
        ({"fault": "stall", "strut": 7}, "strut of stall is 7, valid is 1 to 6"),
        ({"fault": "battery", "volts": "low"}, "volts of battery is 'low', valid is 0 to 60"),
        ({"fault": "cut", "count": 1}, "cut takes no count"),
    ],
)
def test_what_is_no_fault_is_refused_with_what_would_be(request_: object, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        check_fault(request_)


def test_nobody_there_and_no_such_fault_are_errors(start_prototype: Callable, tmp_path: Path) -> None:
    with pytest.raises(PrototypeError, match="is a virtual prototype running there"):
        inject(tmp_path / "nowhere", "reset")
    with pytest.raises(PrototypeError, match="fault is 'explode'"):
        inject(start_prototype().link, "explode")


def test_a_stuck_port_takes_nothing_until_it_is_cleared(start_prototype: Callable) -> None:
    link = start_prototype().link
    transport = SerialTransport(str(link))
    transport.open()
    inject(link, "stuck")
    with pytest.raises(LinkLost, match="took 0 of 4 bytes in time"):
        transport.write_all(b"\x55\x55\x02\x0f")
    inject(link, "clear")
    transport.write_all(b"\x55\x55\x02\x0f")
    assert len(read_exactly(transport, 6)) == 6
    transport.close()


def test_a_supply_sags_for_its_time_and_a_battery_until_cleared(
    start_prototype: Callable, make_bridge: Callable[..., Bridge]
) -> None:
    running = start_prototype(time_scale=20.0)
    bridge = make_bridge(str(running.link), liveness_period_s=0.02)
    bridge.open()
    wait_for(lambda: bridge.snapshot().battery_mv == 7400, "the supply")
    inject(running.link, "brown_out", volts=5.0, seconds=5.0)
    wait_for(lambda: bridge.snapshot().battery_mv == 5000, "the sag")
    wait_for(lambda: bridge.snapshot().battery_mv == 7400, "its end")
    inject(running.link, "battery", volts=6.1)
    wait_for(lambda: bridge.snapshot().battery_mv == 6100, "a low battery")
    inject(running.link, "clear")
    wait_for(lambda: bridge.snapshot().battery_mv == 7400, "a new battery")


def test_a_stalled_strut_stays_and_comes_when_it_is_free_again(
    start_prototype: Callable, make_bridge: Callable[..., Bridge]
) -> None:
    running = start_prototype()
    bridge = make_bridge(str(running.link))
    bridge.open()
    with armed(bridge) as lease:
        inject(running.link, "stall", strut=2)
        target = MID_M + np.array([0.004, 0.004, 0.0, 0.0, 0.0, 0.0])
        assert bridge.execute(Trajectory([1.0], [target]), lease).wait(20.0)
        wait_for(lambda: abs(running.body.lengths_m[0] - target[0]) < 1e-9, "the strut that is free")
        assert running.body.lengths_m[1] == pytest.approx(MID_M)
        inject(running.link, "clear")
        wait_for(lambda: np.allclose(running.body.lengths_m, target), "the other")


def test_a_drop_in_one_direction_leaves_the_other(start_prototype: Callable) -> None:
    link = start_prototype().link
    transport = SerialTransport(str(link))
    transport.open()
    inject(link, "drop", FROM_BOARD, count=2)
    transport.write_all(b"\x55\x55\x02\x0f")
    assert len(read_exactly(transport, 4)) == 4
    inject(link, "drop", TO_BOARD)
    transport.write_all(b"\x55\x55\x02\x0f")
    assert read_exactly(transport, 6, 0.3) == b""
    transport.close()
