# SPDX-License-Identifier: Apache-2.0
"""Bytes of the Maestro boards, against Pololu's user's guide (0J40) 4.e and 5.a to 5.e."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.boards.board import Board, Health
from hardware_bridge.boards.maestro import (
    GET_ERRORS,
    GET_MOVING,
    GO_HOME,
    STOP_SCRIPT,
    Maestro,
    crc7,
    decode_errors,
    speed_units,
    timeout_s,
)
from hardware_bridge.errors import CodecError

COMPACT, POLOLU, CHECKED = Maestro(), Maestro(device=12), Maestro(crc=True)

MANUAL = [
    (COMPACT.set_target(0, 1000), "84 00 20 1F"),
    (COMPACT.set_target(0, 1500), "84 00 70 2E"),
    (COMPACT.set_target(0, 2000), "84 00 40 3E"),
    (COMPACT.set_target(0, 0), "84 00 00 00"),
    (POLOLU.set_target(0, 1500), "AA 0C 04 00 70 2E"),
    (COMPACT.set_speed(5, 140), "87 05 0C 01"),
    (COMPACT.ask_position(0), "90 00"),
    (COMPACT.packet(GET_MOVING), "93"),
    (COMPACT.packet(GET_ERRORS), "A1"),
    (COMPACT.packet(GO_HOME), "A2"),
    (COMPACT.packet(STOP_SCRIPT), "A4"),
]

CRCS = [
    ("83 01", "17"),  # the manual's own; the others are computed by the same rule
    ("84 00 20 1F", "48"),
    ("84 00 70 2E", "2B"),
    ("84 00 40 3E", "35"),
    ("84 02 70 2E", "18"),
    ("90 00", "65"),
    ("A1", "1B"),
    ("A2", "49"),
    ("AA 0C 04 00 70 2E", "22"),
]

variants = st.builds(Maestro, st.none() | st.integers(0, 127), st.booleans())


@pytest.mark.parametrize(("frame", "manual"), MANUAL)
def test_commands_are_the_manuals_bytes(frame: bytes, manual: str) -> None:
    assert frame == bytes.fromhex(manual)


@pytest.mark.parametrize(("packet", "crc"), CRCS)
def test_crcs_are_the_manuals(packet: str, crc: str) -> None:
    assert bytes((crc7(bytes.fromhex(packet)),)) == bytes.fromhex(crc)


def test_a_crc_is_appended_to_every_packet() -> None:
    assert CHECKED.set_target(0, 1500) == bytes.fromhex("84 00 70 2E 2B")
    assert Maestro(12, crc=True).set_target(0, 1500) == bytes.fromhex("AA 0C 04 00 70 2E 22")
    assert CHECKED.encode_query([0]) == (bytes.fromhex("A1 1B 90 00 65"), 4)


@given(variants, st.integers(0, 23), st.integers(0, 4095).map(lambda quarters: quarters / 4))
def test_only_the_first_byte_of_a_packet_has_its_top_bit_set(board: Maestro, channel: int, pulse_us: float) -> None:
    first, *rest = board.set_target(channel, pulse_us)
    assert first & 0x80
    assert not any(byte & 0x80 for byte in rest)


@given(st.binary(max_size=12), st.integers(0, 6), st.integers(0, 200))
def test_a_crc_notices_any_single_wrong_bit(packet: bytes, at: int, bit: int) -> None:
    if packet:
        wrong = bytearray(packet)
        wrong[at % len(packet)] ^= 1 << bit % 8
        assert crc7(wrong) != crc7(packet)


@given(variants, st.lists(st.tuples(st.integers(992, 2000), st.floats(992, 2000)), min_size=1, max_size=6), st.integers(20, 3000))
def test_a_move_is_no_faster_than_told_and_never_at_full_speed_nor_at_none(board: Maestro, ways: list, duration_ms: int) -> None:
    for to_us, from_us in ways:
        units = speed_units(to_us - from_us, duration_ms)
        assert units >= 1
        assert (units + 1) * 25.0 * duration_ms * 1e-3 > abs(to_us - from_us)
        assert units == 1 or units * 25.0 * duration_ms * 1e-3 <= abs(to_us - from_us) + 1e-6
        assert board.move_time_s(to_us - from_us, duration_ms) == abs(to_us - from_us) / (units * 25.0)
    frame = board.encode_move([way[0] for way in ways], range(len(ways)), duration_ms, [way[1] for way in ways])
    assert len(frame) <= board.quirks.longest_frame_bytes


def test_a_move_sets_speeds_before_targets() -> None:
    frame = COMPACT.encode_move([1510, 1500], [1, 2], 50, [1500.0, 1500.0])
    speeds = COMPACT.set_speed(1, 8) + COMPACT.set_speed(2, 1)
    assert frame == speeds + COMPACT.set_target(1, 1510) + COMPACT.set_target(2, 1500)


@given(st.integers(0, 0x1FF), st.lists(st.none() | st.integers(1, 0x3FFF), max_size=6))
def test_a_reply_reads_back(word: int, quarters: list[int | None]) -> None:
    reply = b"".join(value.to_bytes(2, "little") for value in [word, *(quarter or 0 for quarter in quarters)])
    pulses_us = tuple(None if quarter is None else quarter / 4 for quarter in quarters)
    assert COMPACT.parse_reply(reply, len(quarters)) == Health(None, decode_errors(word), pulses_us)


@given(st.binary(max_size=20), st.integers(0, 6))
def test_the_parser_survives_any_bytes(reply: bytes, count: int) -> None:
    health = COMPACT.parse_reply(reply, count)
    assert health is None or len(reply) == 2 + 2 * count


def test_errors_have_names() -> None:
    assert decode_errors(0b000101000) == ("serial CRC", "serial time-out")
    assert decode_errors(0b100000001) == ("serial signal", "script program counter")


def test_the_time_out_to_set_follows_the_queries_and_what_the_board_can() -> None:
    assert timeout_s(1.0) == 4.0
    assert timeout_s(0.001) == 0.01
    assert timeout_s(1e4) == 655.35


@pytest.mark.parametrize(
    ("pulses", "on", "duration"),
    [([991], [1], 100), ([2001], [1], 100), ([1500], [-1], 100), ([1500], [24], 100), ([1500], [1], 19), ([1500], [1], 30001),
     ([1500] * 7, range(7), 100), ([], [], 100), ([1500, 1500], [1], 100), ([1500, 1500], [1, 1], 100), ([1500.5], [1], 100)],
)  # fmt: skip
def test_what_the_board_cannot_do_is_not_encoded(pulses: list[int], on: list[int], duration: int) -> None:
    with pytest.raises(CodecError, match="valid is"):
        COMPACT.encode_move(pulses, on, duration, [1500.0] * len(pulses))


def test_the_board_is_one_and_states_its_quirks() -> None:
    board: Board = Maestro(12, True)
    assert board.spec == "maestro:device=12:crc"
    assert board.quirks.error_moves
    assert board.quirks.has_timeout
    assert board.encode_hold([1500], [0], 55) == bytes.fromhex("AA 0C 04 00 70 2E 22")
    with pytest.raises(CodecError, match="device is 128"):
        Maestro(128)
