# SPDX-License-Identifier: Apache-2.0
import pytest

from hardware_bridge.boards.lsc import CMD_UNLOAD, Lsc, encode_frame
from hardware_bridge.virtual_prototype.boards.lsc import EmulatedLsc
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order

MOVE = Lsc().encode_move([1600] * 6, range(1, 7), 500)
OBEYED = Order(dict.fromkeys(range(1, 7), 1600), 0.5)


def orders_of(data: bytes) -> list[Order]:
    board = EmulatedLsc(9600)
    board.receive(data, 0.0)
    board.process(1e9)
    return [order for _, order in board.orders]


def test_an_unload_lets_go() -> None:
    assert orders_of(encode_frame(CMD_UNLOAD, bytes((2, 1, 2)))) == [Order({1: None, 2: None})]


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
    assert orders_of(nonsense + MOVE) == [OBEYED]


@pytest.mark.parametrize("kept", range(5, 25))
def test_a_cut_frame_swallows_the_next_one(kept: int) -> None:
    assert len(orders_of(MOVE[:kept] + MOVE)) == 0
    assert orders_of(MOVE[:kept] + MOVE * 4)[-1] == OBEYED
