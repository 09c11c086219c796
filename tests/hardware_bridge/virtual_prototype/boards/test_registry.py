# SPDX-License-Identifier: Apache-2.0
"""What every emulated board does, whatever its bytes are."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Outputs
from hardware_bridge.virtual_prototype.boards.registry import emulate
from tests.hardware_bridge.boards.test_registry import SPECS

CHANNELS = (1, 2, 3, 4, 5, 6)
each_board = pytest.mark.parametrize("spec", SPECS)


def move(spec: str, pulse_us: int, duration_ms: int, from_us: float = 1500.0) -> bytes:
    return parse_board(spec).encode_move([pulse_us] * 6, CHANNELS, duration_ms, [from_us] * 6)


def pulses(orders: object, time_s: float) -> list[float]:
    outputs = Outputs()
    for at_s, order in orders:  # type: ignore[attr-defined]
        outputs.follow(order, at_s)
    return [outputs.pulse_us(channel, time_s) for channel in CHANNELS]


@each_board
def test_bytes_come_in_at_the_baud_rate(spec: str) -> None:
    board, frame = emulate(spec, 9600), move(spec, 1600, 500)
    board.receive(frame + frame, 10.0)
    end_s = 10.0 + len(frame) / 960
    board.process(end_s - 0.1 / 960)
    assert not board.orders or spec.startswith("maestro")
    board.process(end_s + 0.1 / 960)
    assert board.orders[-1][0] == pytest.approx(end_s)
    assert board.waiting_bytes == len(frame)


@each_board
def test_moves_are_not_acknowledged_and_a_query_is_answered_as_long_as_it_says(spec: str) -> None:
    board, codec = emulate(spec), parse_board(spec)
    board.receive(move(spec, 1600, 500), 0.0)
    assert board.process(1.0) == b""
    query = codec.encode_query(CHANNELS)
    board.receive(query.data, 1.0)
    reply = board.process(2.0)
    assert len(reply) == query.reply_bytes
    health = codec.parse_reply(reply, 6)
    assert health is not None
    assert health.errors == ()
    assert health.pulses_us == ((1600.0,) * 6 if codec.quirks.tells_pulses else ())
    assert health.battery_mv == (7400 if spec == "lsc" else None)


@each_board
def test_the_first_move_jumps_and_the_second_takes_its_time(spec: str) -> None:
    board = emulate(spec)
    board.receive(move(spec, 1500, 5000), 0.0)
    board.receive(move(spec, 1600, 1000), 1.0)
    board.process(9.0)
    assert pulses(board.orders, 0.9) == [1500] * 6
    assert pulses(board.orders, 1.5) == pytest.approx([1550] * 6, abs=3.0)
    assert pulses(board.orders, 2.1) == [1600] * 6


@each_board
def test_a_hold_goes_no_further_than_the_last_move(spec: str) -> None:
    board = emulate(spec)
    board.receive(move(spec, 1500, 20), 0.0)
    board.receive(move(spec, 1510, 55), 1.0)
    board.receive(parse_board(spec).encode_hold([1510] * 6, CHANNELS, 55), 1.02)
    board.process(9.0)
    assert max(pulses(board.orders, 1.06)) <= 1510
    assert pulses(board.orders, 1.2) == [1510] * 6


@pytest.mark.parametrize("spec", [spec for spec in SPECS if parse_board(spec).quirks.tells_pulses])
def test_what_a_board_answers_is_what_was_commanded_and_not_where_it_is(spec: str) -> None:
    board, codec = emulate(spec), parse_board(spec)
    board.receive(move(spec, 1500, 20), 0.0)
    board.receive(move(spec, 1600, 1000), 1.0)
    board.receive(codec.encode_query(CHANNELS).data, 1.5)
    health = codec.parse_reply(board.process(1.6), 6)
    assert health is not None
    assert health.pulses_us == pytest.approx((1550,) * 6, abs=10.0)


@each_board
def test_a_reset_takes_the_pulses_off_and_says_so_where_it_can(spec: str) -> None:
    board, codec = emulate(spec), parse_board(spec)
    board.receive(move(spec, 1600, 500), 0.0)
    board.process(1.0)
    board.receive(move(spec, 1700, 500)[:-2], 1.0)
    board.process(1.001)
    board.reset(1.001)
    assert all(pulse != pulse for pulse in pulses(board.orders, 1.1))
    board.receive(codec.encode_query(CHANNELS).data, 2.0)
    health = codec.parse_reply(board.process(3.0), 6)
    assert health is not None
    assert health.errors == ()
    assert health.pulses_us == ((None,) * 6 if codec.quirks.tells_pulses else ())


@each_board
@given(pieces=st.lists(st.binary(max_size=40), max_size=10))
def test_any_bytes_leave_only_pulses_that_a_board_can_give(spec: str, pieces: list[bytes]) -> None:
    board = emulate(spec)
    for time_s, piece in enumerate(pieces):
        board.receive(piece, float(time_s))
        board.process(float(time_s))
    board.process(1e3)
    assert all(pulse != pulse or 400 <= pulse <= 2600 for pulse in pulses(board.orders, 2e3))
