# SPDX-License-Identifier: Apache-2.0
"""The link against emulated boards without a pty between, so that a frame can be cut anywhere."""

import pytest

from hardware_bridge.boards.board import Board
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.errors import LinkLost
from hardware_bridge.link.board_health import Answer
from hardware_bridge.link.board_link import Link
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.maestro import ControlCenter, EmulatedMaestro
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Outputs
from hardware_bridge.virtual_prototype.boards.registry import emulate

CHANNELS = (1, 2, 3, 4, 5, 6)
ALL_ON = (True,) * 6
LIMIT_S = 4.0


class CutTransport:
    """Carries bytes to an emulated board at once, and cuts the next write where it is told to."""

    port = "cut"

    def __init__(self, board: EmulatedBoard) -> None:
        self.board = board
        self.cut_at: int | None = None
        self.mute = False
        self.replies = b""
        self.now_s = 0.0

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write_all(self, data: bytes) -> None:
        cut, self.cut_at = self.cut_at, None
        self.now_s += 1.0
        self.board.receive(data[:cut], self.now_s)
        self.now_s += 1.0
        self.replies += self.board.process(self.now_s)
        if cut is not None:
            raise LinkLost(self.port, "cut", "", dirty=cut > 0)

    def read_available(self, limit: int = 256) -> bytes:
        replies, self.replies = self.replies, b""
        return b"" if self.mute else replies

    def pulses_us(self) -> list[float]:
        outputs = Outputs()
        for time_s, order in self.board.orders:
            outputs.follow(order, time_s)
        return [outputs.pulse_us(channel, self.now_s) for channel in CHANNELS]


class Setup:
    """A link over a board that has moved once, so that its channels stand at 1500 us."""

    def __init__(self, spec: str, settings: ControlCenter | None = None) -> None:
        self.codec: Board = parse_board(spec)
        self.transport = CutTransport(emulate(spec, settings=settings))
        self.link = Link(self.transport, self.codec, CHANNELS, 1.0, LIMIT_S)  # type: ignore[arg-type]
        self.link.open()
        self.link.write(self.move(1500))

    def move(self, pulse_us: int) -> bytes:
        return self.codec.encode_move([pulse_us] * 6, CHANNELS, 500, [1500.0] * 6)

    def ask(self, now_s: float) -> Answer | None:
        self.link.attend(now_s, ALL_ON)
        return self.link.attend(now_s + 0.1, ALL_ON)

    def cut_and_reopen(self, at: int) -> None:
        self.transport.cut_at = at
        with pytest.raises(LinkLost):
            self.link.write(self.move(1600))
        assert not self.link.is_up
        self.link.open()
        assert self.link.is_up == (at == 0), "nobody else uses a dirty link"


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hardware_bridge.link.board_link._REPLY_LIMIT_S", 0.002)


def every_cut(*specs: str) -> pytest.MarkDecorator:
    cuts = [(spec, at) for spec in specs for at in range(1, len(Setup(spec).move(1600)))]
    return pytest.mark.parametrize(("spec", "at"), cuts)


@every_cut("lsc", "ssc32")
@pytest.mark.parametrize("answers", [True, False])
def test_after_a_cut_frame_nothing_moves_and_the_next_one_is_obeyed(spec: str, at: int, answers: bool) -> None:
    setup = Setup(spec)
    if answers:
        assert setup.ask(0.0) is not None
    setup.cut_and_reopen(at)
    assert setup.link.resynchronise()
    assert setup.link.is_up
    assert setup.transport.pulses_us() == [1500] * 6, "neither cancel nor queries complete a move that a board accepts"
    setup.link.write(setup.move(1600))
    assert setup.transport.pulses_us() == [1600] * 6


@every_cut("maestro", "maestro:device=12:crc")
@pytest.mark.parametrize("home_us", [None, 0.0, 1200.0])
def test_a_cut_frame_may_send_a_maestro_home_and_the_next_one_is_obeyed(spec: str, at: int, home_us: float | None) -> None:
    setup = Setup(spec, ControlCenter(home_us))
    assert setup.ask(0.0) is not None
    setup.cut_and_reopen(at)
    assert setup.link.resynchronise()
    setup.link.write(setup.move(1600))
    assert setup.transport.pulses_us() == pytest.approx([1600] * 6, abs=400), "they are somewhere: hence positions unknown"
    setup.transport.now_s += 60.0
    assert setup.transport.pulses_us() == [1600] * 6
    answer = setup.ask(10.0)
    assert answer is not None
    assert answer.health.errors == (), "resynchronising has read them"


@pytest.mark.parametrize("spec", ["lsc", "ssc32", "maestro"])
def test_a_board_that_used_to_answer_and_does_not_keeps_the_link_down(spec: str) -> None:
    setup = Setup(spec)
    assert setup.ask(0.0) is not None
    setup.cut_and_reopen(10)
    setup.transport.mute = True
    with pytest.raises(LinkLost, match="supply off and on"):
        setup.link.resynchronise()
    assert not setup.link.is_up


def test_a_clean_stream_needs_no_resynchronising() -> None:
    setup = Setup("lsc")
    setup.cut_and_reopen(0)
    written_s = setup.transport.now_s
    assert not setup.link.resynchronise()
    assert setup.transport.now_s == written_s, "nothing more was written"


# ---- answers --------------------------------------------------------------------------------------------------------


def test_an_lsc_tells_its_voltage() -> None:
    setup = Setup("lsc")
    answer = setup.ask(0.0)
    assert answer is not None
    assert answer.health.battery_mv == setup.link.battery_mv == 7400


@pytest.mark.parametrize("spec", ["ssc32", "maestro"])
@pytest.mark.parametrize("spoilt", [b"", b"\x96", b"\xff" * 6, b"\xff" * 14, b"\x96" * 30])
def test_short_and_corrupted_answers_are_asked_again_and_at_last_a_lost_link(spec: str, spoilt: bytes) -> None:
    setup = Setup(spec)
    assert setup.ask(0.0) is not None
    setup.transport.mute = True
    for second in range(1, 4):
        setup.link.attend(float(second), ALL_ON)
        setup.transport.mute, setup.transport.replies = False, spoilt
        assert setup.link.attend(second + 0.1, ALL_ON) is None
        setup.transport.mute = True
    with pytest.raises(LinkLost, match="has not answered for 4 s"):
        setup.link.attend(5.0, ALL_ON)
    assert setup.link.replies.bad == (0 if spoilt == b"" else 2), "each is counted by the question after it"


@pytest.mark.parametrize("spec", ["ssc32", "maestro"])
def test_what_was_left_over_before_a_question_is_no_answer(spec: str) -> None:
    setup = Setup(spec)
    setup.transport.replies = b"\x00" * setup.codec.encode_query(CHANNELS).reply_bytes
    answer = setup.ask(0.0)
    assert answer is not None
    assert answer.health.pulses_us == (1500.0,) * 6


def test_a_channel_that_should_hold_and_gives_no_pulse_is_named_once_it_must_have_been_asked_with_power() -> None:
    setup = Setup("ssc32")
    setup.link.open()
    setup.link.attend(0.0, (False,) * 6)
    setup.transport.board.reset(setup.transport.now_s)
    for second in range(1, 9):
        answer = setup.ask(float(second))
        assert answer is not None
        assert answer.silent_channels == ((0, 1, 2, 3, 4, 5) if second > LIMIT_S else ())


def test_latched_errors_are_told_once() -> None:
    setup = Setup("maestro")
    assert isinstance(setup.transport.board, EmulatedMaestro)
    setup.transport.board.receive(b"\x00", setup.transport.now_s)
    answers = [setup.ask(0.0), setup.ask(1.0)]
    assert [answer and answer.health.errors for answer in answers] == [("serial protocol",), ()]
