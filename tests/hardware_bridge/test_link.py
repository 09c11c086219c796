"""The link against an emulated board without a pty between, so that a frame can be cut anywhere."""

from __future__ import annotations

import pytest

from hardware_bridge.codecs.lsc import Lsc, encode_move
from hardware_bridge.errors import LinkLost
from hardware_bridge.link import Link
from hardware_bridge.virtual_prototype.lsc_board import EmulatedLsc

MOVE = encode_move([1600] * 6, range(1, 7), 500)


class CutTransport:
    """Carries bytes to an emulated board at once, and cuts the next write where it is told to."""

    port = "cut"

    def __init__(self) -> None:
        self.board = EmulatedLsc()
        self.cut_at: int | None = None
        self.mute = False
        self._replies = b""
        self._now_s = 0.0

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write_all(self, data: bytes) -> None:
        cut, self.cut_at = self.cut_at, None
        self._now_s += 1.0
        self.board.receive(data[:cut], self._now_s)
        self._now_s += 1.0
        self._replies += self.board.process(self._now_s)
        if cut is not None:
            raise LinkLost(self.port, "cut", "", dirty=cut > 0)

    def read_available(self, limit: int = 256) -> bytes:
        replies, self._replies = self._replies, b""
        return b"" if self.mute else replies


@pytest.fixture
def transport(monkeypatch: pytest.MonkeyPatch) -> CutTransport:
    monkeypatch.setattr("hardware_bridge.link._REPLY_LIMIT_S", 0.002)
    return CutTransport()


def link_over(transport: CutTransport) -> Link:
    link = Link(transport, Lsc(), range(1, 7), 1.0, 4.0)  # type: ignore[arg-type]
    link.open()
    return link


def cut_and_reopen(link: Link, transport: CutTransport, at: int) -> None:
    transport.cut_at = at
    with pytest.raises(LinkLost):
        link.write(MOVE)
    assert not link.is_up
    link.open()


@pytest.mark.parametrize("at", range(1, 25))
@pytest.mark.parametrize("answers", [True, False])
def test_after_a_cut_frame_nothing_moves_and_the_next_one_is_obeyed(transport: CutTransport, at: int, answers: bool) -> None:
    link = link_over(transport)
    if answers:
        link.attend(0.0)
        link.attend(0.1)
        assert link.battery_mv == 7400
    cut_and_reopen(link, transport, at)
    link.resynchronise()
    assert not transport.board.orders, "queries complete no move that a board accepts"
    link.write(MOVE)
    assert len(transport.board.orders) == 1


def test_a_board_that_used_to_answer_and_does_not_keeps_the_link_down(transport: CutTransport) -> None:
    link = link_over(transport)
    link.attend(0.0)
    link.attend(0.1)
    cut_and_reopen(link, transport, 10)
    transport.mute = True
    with pytest.raises(LinkLost, match="supply off and on"):
        link.resynchronise()
    assert not link.is_up


def test_a_clean_stream_needs_no_resynchronising(transport: CutTransport) -> None:
    link = link_over(transport)
    cut_and_reopen(link, transport, 0)
    link.resynchronise()
    assert transport.board.waiting_bytes == 0
    assert transport._now_s == 2.0, "nothing more was written"
