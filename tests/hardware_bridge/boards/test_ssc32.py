# SPDX-License-Identifier: Apache-2.0
"""Bytes of the SSC-32 boards, against the SSC-32U guide, pp. 24-26, 33-34, 38-39, and against any bytes at all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.boards.board import Board, Health
from hardware_bridge.boards.ssc32 import (
    CANCEL,
    MAX_LINE,
    AskMoving,
    AskPulses,
    Group,
    LineDecoder,
    Offset,
    Ssc32,
    Stop,
    Target,
    decode_line,
    encode_pulse_reply,
)
from hardware_bridge.errors import CodecError

encode_move = Ssc32().encode_move

MANUAL = [
    (encode_move([1600], [5], 1000), b"#5P1600T1000\r"),
    (encode_move([1600], [5], 1000), bytes.fromhex("23 35 50 31 36 30 30 54 31 30 30 30 0D")),
    (encode_move([1500] * 6, range(6), 1000), b"#0P1500#1P1500#2P1500#3P1500#4P1500#5P1500T1000\r"),
    (Ssc32().encode_query([5]).data, b"QP5\r"),
    (Ssc32().encode_query([0, 1]).data, b"QP0QP1\r"),
    (CANCEL, bytes.fromhex("1B 0D")),
    (encode_pulse_reply([1500]), bytes.fromhex("96")),
]

UNDERSTOOD = [
    (b"#5P1600T1000", Group((Target(5, 1600),), 1000)),
    (b"#5 P1600 #10 P750 T2500", Group((Target(5, 1600), Target(10, 750)), 2500)),
    (b"#5P1600S750", Group((Target(5, 1600, 750),))),
    (b"#5p1600s750\tt9\n", Group((Target(5, 1600, 750),), 9)),
    (b"#5L", Group((Target(5, None),))),
    (b"#5P0", Group((Target(5, None),))),
    (b"#5PO-20", Offset(5, -20)),
    (b"STOP 5", Stop(5)),
    (b"Q", AskMoving()),
    (b"QP5", AskPulses((5,))),
    (b"QP0QP1", AskPulses((0, 1))),
]

channels = st.lists(st.integers(0, 31), min_size=1, max_size=6, unique=True)


@st.composite
def moves(draw: st.DrawFn) -> tuple[list[int], list[int], int]:
    chosen = draw(channels)
    pulses = draw(st.lists(st.integers(500, 2500), min_size=len(chosen), max_size=len(chosen)))
    return pulses, chosen, draw(st.integers(20, 65535))


def group_of(move: tuple[list[int], list[int], int]) -> Group:
    pulses, chosen, duration_ms = move
    return Group(tuple(Target(*pair) for pair in zip(chosen, pulses, strict=True)), duration_ms)


@pytest.mark.parametrize(("frame", "manual"), MANUAL)
def test_commands_are_the_manuals_bytes(frame: bytes, manual: bytes) -> None:
    assert frame == manual


@pytest.mark.parametrize(("line", "command"), UNDERSTOOD)
def test_the_manuals_commands_are_understood(line: bytes, command: object) -> None:
    assert decode_line(line) == command


def test_no_frame_is_longer_than_is_said() -> None:
    frame = encode_move([2500] * 6, range(26, 32), 65535)
    assert len(encode_move([1500] * 6, range(6), 1000)) == 48
    assert len(frame) <= Ssc32().quirks.longest_frame_bytes


@given(moves())
def test_a_move_reads_back(move: tuple[list[int], list[int], int]) -> None:
    assert LineDecoder().feed(encode_move(*move)) == [group_of(move)]


@given(st.lists(moves(), max_size=5), st.data())
def test_commands_arrive_whole_in_pieces_of_any_size(sent: list[tuple[list[int], list[int], int]], data: st.DataObject) -> None:
    stream = b"".join(encode_move(*move) for move in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    decoder, got = LineDecoder(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        got += decoder.feed(stream[start:end])
    assert got == [group_of(move) for move in sent]


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_the_decoder_survives_any_bytes_and_gives_only_what_a_board_can_do(pieces: list[bytes]) -> None:
    decoder = LineDecoder()
    for command in [command for piece in pieces for command in decoder.feed(piece)]:
        if isinstance(command, Group):
            assert all(target.pulse_us is None or 500 <= target.pulse_us <= 2500 for target in command.targets)
            assert all(0 <= target.channel <= 31 for target in command.targets)


@given(st.text("#PSTLOQVER0123456789 -\r\x1b", max_size=80))
def test_the_decoder_survives_whatever_looks_like_a_command(text: str) -> None:
    LineDecoder().feed(text.encode())


def test_a_line_without_an_end_is_not_kept_for_ever() -> None:
    decoder = LineDecoder()
    assert decoder.feed(b"#" * 100_000) == []
    assert len(decoder._line) <= MAX_LINE + 1
    assert decoder.feed(b"\r" + b"Q\r") == [AskMoving()]


@given(moves(), moves(), st.data())
def test_a_cancel_ends_a_cut_frame(cut: tuple, move: tuple, data: st.DataObject) -> None:
    frame = encode_move(*cut)
    kept = frame[: data.draw(st.integers(0, len(frame) - 1))]
    assert LineDecoder().feed(kept + CANCEL + encode_move(*move)) == [group_of(move)]


@given(st.lists(st.none() | st.integers(50, 250).map(lambda tens: tens * 10.0), max_size=6))
def test_pulses_read_back(pulses_us: list[float | None]) -> None:
    assert Ssc32().parse_reply(encode_pulse_reply(pulses_us), len(pulses_us)) == Health(pulses_us=tuple(pulses_us))


@given(st.binary(max_size=10), st.integers(1, 6))
def test_only_a_sound_reply_is_believed(reply: bytes, count: int) -> None:
    health = Ssc32().parse_reply(reply, count)
    sound = len(reply) == count and all(byte == 0 or 50 <= byte <= 250 for byte in reply)
    assert (health is not None) == sound


@pytest.mark.parametrize(
    "nonsense",
    [b"", b"#", b"#5", b"#32P1500", b"#5P499", b"#5P2501", b"#5P1500T65536", b"#5P1500T", b"T100", b"QP32", b"QX", b"VA", b"VER",
     b"STOP 32", b"#5PO-101", b"#5PO200", b"#5P1500#5P15T20#5P1500", "#٥P1500".encode(), b"\xff\x00", b"#1P1500#2P15#1P1500T55"],
)  # fmt: skip
def test_nonsense_is_no_command(nonsense: bytes) -> None:
    assert decode_line(nonsense) is None


@pytest.mark.parametrize(
    ("pulses", "on", "duration"),
    [([499], [1], 100), ([2501], [1], 100), ([1500], [-1], 100), ([1500], [32], 100), ([1500], [1], 19), ([1500], [1], 65536),
     ([1500] * 7, range(7), 100), ([], [], 100), ([1500, 1500], [1], 100), ([1500, 1500], [1, 1], 100), ([1500.5], [1], 100)],
)  # fmt: skip
def test_what_the_board_cannot_do_is_not_encoded(pulses: list[int], on: list[int], duration: int) -> None:
    with pytest.raises(CodecError, match="valid is"):
        encode_move(pulses, on, duration)


def test_the_board_is_one_and_states_its_quirks() -> None:
    board: Board = Ssc32()
    assert board.encode_move([1500], [1], 100, [1490.0]) == b"#1P1500T100\r"
    assert board.encode_hold([1500], [1], 55) == b"#1P1500T55\r"
    assert board.encode_query(range(1, 7)) == (b"QP1QP2QP3QP4QP5QP6\r", 6)
    assert board.parse_reply(bytes((150, 0)), 2) == Health(pulses_us=(1500.0, None))
    assert board.quirks.cancel == CANCEL
    assert board.quirks.tells_pulses
