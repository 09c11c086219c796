# SPDX-License-Identifier: Apache-2.0
"""Bytes of the LSC boards, against the maker's "controller communication protocol" V1.2, and against any bytes at all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.boards.board import Board, Health
from hardware_bridge.boards.lsc import (
    CMD_BATTERY,
    CMD_UNLOAD,
    Frame,
    FrameDecoder,
    Lsc,
    Move,
    decode_battery_reply,
    decode_move,
    decode_unload,
    encode_battery_reply,
    encode_frame,
)
from hardware_bridge.errors import CodecError

encode_move = Lsc().encode_move

GOLDEN = [
    (encode_move([2000], [1], 1000), "55 55 08 03 01 E8 03 01 D0 07"),
    (encode_move([1200, 2300], [2, 9], 800), "55 55 0B 03 02 20 03 02 B0 04 09 FC 08"),
    (
        encode_move([1500] * 6, range(1, 7), 1000),
        "55 55 17 03 06 E8 03 01 DC 05 02 DC 05 03 DC 05 04 DC 05 05 DC 05 06 DC 05",
    ),
    (encode_frame(0x07), "55 55 02 07"),
    (Lsc().encode_query([1]).data, "55 55 02 0F"),
    (encode_battery_reply(7400), "55 55 04 0F E8 1C"),
    (encode_frame(CMD_UNLOAD, bytes((6, *range(1, 7)))), "55 55 09 14 06 01 02 03 04 05 06"),
]

channels = st.lists(st.integers(1, 32), min_size=1, max_size=6, unique=True)


@st.composite
def moves(draw: st.DrawFn) -> Move:
    chosen = draw(channels)
    pulses = draw(st.lists(st.integers(500, 2500), min_size=len(chosen), max_size=len(chosen)))
    return Move(tuple(chosen), tuple(pulses), draw(st.integers(20, 30000)))


def bytes_of(move: Move) -> bytes:
    return encode_move(move.pulses_us, move.channels, move.duration_ms)


@pytest.mark.parametrize(("frame", "manual"), GOLDEN)
def test_frames_are_the_manuals_bytes(frame: bytes, manual: str) -> None:
    assert frame == bytes.fromhex(manual)


def test_six_servos_take_25_bytes() -> None:
    assert len(encode_move([1500] * 6, range(1, 7), 55)) == 25


@given(moves())
def test_a_move_reads_back(move: Move) -> None:
    (frame,) = FrameDecoder().feed(bytes_of(move))
    assert decode_move(frame) == move


@given(st.integers(0, 0xFFFF))
def test_a_battery_reply_reads_back(millivolts: int) -> None:
    (frame,) = FrameDecoder().feed(encode_battery_reply(millivolts))
    assert decode_battery_reply(frame) == millivolts


@given(channels)
def test_an_unload_reads_back(chosen: list[int]) -> None:
    (frame,) = FrameDecoder().feed(encode_frame(CMD_UNLOAD, bytes((len(chosen), *chosen))))
    assert decode_unload(frame) == tuple(chosen)


@given(st.lists(moves(), max_size=5), st.data())
def test_frames_arrive_whole_in_pieces_of_any_size(sent: list[Move], data: st.DataObject) -> None:
    stream = b"".join(map(bytes_of, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    decoder, got = FrameDecoder(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        got += decoder.feed(stream[start:end])
    assert [decode_move(frame) for frame in got] == sent


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_the_decoder_survives_any_bytes_and_holds_no_more_than_a_frame(pieces: list[bytes]) -> None:
    decoder = FrameDecoder()
    whole = b"".join(pieces)
    frames = [frame for piece in pieces for frame in decoder.feed(piece)]
    assert frames == FrameDecoder().feed(whole)
    assert sum(len(frame.parameters) + 4 for frame in frames) <= len(whole)
    for frame in frames:
        decode_move(frame), decode_unload(frame), decode_battery_reply(frame)


@given(st.binary(max_size=60).filter(lambda noise: 0x55 not in noise), moves())
def test_a_frame_after_noise_is_found(noise: bytes, move: Move) -> None:
    frames = FrameDecoder().feed(noise + bytes_of(move))
    assert decode_move(frames[-1]) == move


@given(moves(), st.data())
def test_after_a_cut_frame_the_stream_heals_within_a_few_frames(move: Move, data: st.DataObject) -> None:
    frame = bytes_of(move)
    cut = data.draw(st.integers(1, len(frame) - 1))
    healed = FrameDecoder().feed(frame[:cut] + frame * 12)
    assert decode_move(healed[-1]) == move


@pytest.mark.parametrize(
    ("pulses", "on", "duration"),
    [
        ([499], [1], 100),
        ([2501], [1], 100),
        ([1500], [0], 100),
        ([1500], [33], 100),
        ([1500], [1], 19),
        ([1500], [1], 30001),
        ([1500] * 7, range(1, 8), 100),
        ([], [], 100),
        ([1500, 1500], [1], 100),
        ([1500, 1500], [1, 1], 100),
        ([1500.0], [1], 100),
        ([True], [1], 100),
    ],
)
def test_what_the_board_cannot_do_is_not_encoded(pulses: list[int], on: list[int], duration: int) -> None:
    with pytest.raises(CodecError, match="valid is"):
        encode_move(pulses, on, duration)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x03, b""),
        Frame(0x03, bytes((1, 0, 1))),
        Frame(0x03, bytes((2, 0, 1, 1, 0xDC, 5))),
        Frame(0x03, bytes((1, 0, 1, 1, 0, 0))),
        Frame(0x03, bytes((1, 0, 1, 0, 0xDC, 5))),
        Frame(0x06, bytes((1, 0, 1, 1, 0xDC, 5))),
    ],
)
def test_nonsense_is_no_move(frame: Frame) -> None:
    assert decode_move(frame) is None


def test_the_board_is_one_and_states_its_quirks() -> None:
    board: Board = Lsc()
    assert board.encode_move([1500], [1], 100, [1490.0]) == encode_move([1500], [1], 100)
    assert board.encode_hold([1500], [1], 55) == encode_move([1500], [1], 55)
    assert board.encode_query([1]) == (encode_frame(CMD_BATTERY), 6)
    assert not board.quirks.tells_pulses
    assert not board.quirks.error_moves


def test_the_newest_voltage_is_found_among_other_replies() -> None:
    others = b"\x00" + encode_battery_reply(7000) + encode_frame(0x08, bytes(3))
    assert Lsc().parse_reply(others + encode_battery_reply(6900), 6) == Health(battery_mv=6900)
    assert Lsc().parse_reply(others[:5], 6) is None
