from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.codecs.lsc import (
    Move,
    encode_battery_query,
    encode_battery_reply,
    encode_frame,
    encode_move,
    encode_unload,
)
from hardware_bridge.virtual_prototype.board import BATTERY_MV, LscBoard, Outputs, Unload

MOVE = encode_move([1600] * 6, range(1, 7), 500)


def orders_of(data: bytes) -> list[Move | Unload]:
    board = LscBoard(9600)
    board.receive(data, 0.0)
    board.process(1e9)
    return [order for _, order in board.orders]


def test_bytes_come_in_at_the_baud_rate() -> None:
    board = LscBoard(9600)
    board.receive(MOVE + MOVE, 10.0)
    board.process(10.0 + 24.9 / 960)
    assert not board.orders
    board.process(10.0 + 25.1 / 960)
    assert [time_s for time_s, _ in board.orders] == pytest.approx([10.0 + 25 / 960])
    assert board.waiting_bytes == 25
    board.process(11.0)
    assert board.orders[1][0] == pytest.approx(10.0 + 50 / 960)


def test_moves_are_not_acknowledged_and_battery_queries_are_answered() -> None:
    board = LscBoard(9600)
    board.receive(MOVE, 0.0)
    assert board.process(1.0) == b""
    board.receive(encode_battery_query(), 1.0)
    assert board.process(2.0) == encode_battery_reply(BATTERY_MV)


def test_the_first_move_ignores_its_duration() -> None:
    outputs = Outputs()
    assert math.isnan(outputs.pulse_us(1, 0.0))
    outputs.follow(Move((1,), (1800,), 5000), 1.0)
    assert outputs.pulse_us(1, 1.0) == 1800


def test_later_moves_go_straight_from_where_the_output_is() -> None:
    outputs = Outputs()
    outputs.follow(Move((1,), (1500,), 0), 0.0)
    outputs.follow(Move((1,), (1600,), 1000), 0.0)
    assert outputs.pulse_us(1, 0.25) == 1525
    outputs.follow(Move((1,), (1500,), 500), 0.5)
    assert outputs.pulse_us(1, 0.5) == 1550
    assert outputs.pulse_us(1, 0.75) == 1525
    assert outputs.pulse_us(1, 9.0) == 1500


def test_an_unloaded_channel_gives_no_pulse_and_forgets() -> None:
    outputs = Outputs()
    outputs.follow(Move((1,), (1500,), 0), 0.0)
    outputs.follow(Unload((1,)), 1.0)
    assert math.isnan(outputs.pulse_us(1, 1.0))
    outputs.follow(Move((1,), (1900,), 5000), 2.0)
    assert outputs.pulse_us(1, 2.0) == 1900
    assert orders_of(encode_unload([1, 2])) == [Unload((1, 2))]


@pytest.mark.parametrize(
    "nonsense",
    [
        encode_frame(0x03, bytes((1, 0, 1, 1, 0, 0))),
        encode_frame(0x03, bytes((2, 0, 1, 1, 0xDC, 5, 99, 0xDC, 5))),
        encode_frame(0x99, b"xyz"),
        encode_frame(0x07),
        b"\x00\x12\x55\x55\x01\x03",
    ],
)
def test_nonsense_does_nothing_and_the_next_frame_is_obeyed(nonsense: bytes) -> None:
    assert orders_of(nonsense + MOVE) == [Move((1, 2, 3, 4, 5, 6), (1600,) * 6, 500)]


@pytest.mark.parametrize("kept", range(5, 25))
def test_a_cut_frame_swallows_the_next_one(kept: int) -> None:
    assert len(orders_of(MOVE[:kept] + MOVE)) == 0
    assert orders_of(MOVE[:kept] + MOVE * 4)[-1] == Move((1, 2, 3, 4, 5, 6), (1600,) * 6, 500)


@given(st.lists(st.binary(max_size=30), max_size=10))
def test_any_bytes_leave_only_pulses_that_a_board_can_give(pieces: list[bytes]) -> None:
    for order in orders_of(b"".join(pieces)):
        if isinstance(order, Move):
            assert all(500 <= pulse <= 2500 for pulse in order.pulses_us)
