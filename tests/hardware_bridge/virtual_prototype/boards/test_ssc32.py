# SPDX-License-Identifier: Apache-2.0
import pytest

from hardware_bridge.virtual_prototype.boards.pulse_outputs import Outputs
from hardware_bridge.virtual_prototype.boards.ssc32 import EmulatedSsc32


class Bench:
    """A board on a table: lines in, replies and pulses out."""

    def __init__(self) -> None:
        self.board = EmulatedSsc32(115200)
        self.outputs = Outputs()
        self.now_s = 0.0

    def send(self, data: bytes) -> bytes:
        self.board.receive(data, self.now_s)
        self.now_s += 0.02
        reply = self.board.process(self.now_s)
        while self.board.orders:
            time_s, order = self.board.orders.popleft()
            self.outputs.follow(order, time_s)
        return reply

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.board.process(self.now_s)

    def pulse_us(self, channel: int) -> float:
        return self.outputs.pulse_us(channel, self.now_s)


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.send(b"#5P1500#6P1500\r")
    return bench


def test_a_group_stops_together(bench: Bench) -> None:
    bench.send(b"#5 P1600 #6 P1510 T1000\r")
    bench.wait(0.48)
    assert (bench.pulse_us(5), bench.pulse_us(6)) == pytest.approx((1550, 1505), abs=3)
    bench.wait(0.6)
    assert (bench.pulse_us(5), bench.pulse_us(6)) == (1600, 1510)


def test_a_speed_makes_a_move_take_longer_than_its_time(bench: Bench) -> None:
    bench.send(b"#5P1600S100T100\r")
    bench.wait(0.48)
    assert bench.pulse_us(5) == pytest.approx(1550, abs=3)


def test_it_tells_whether_it_moves_and_what_it_gives(bench: Bench) -> None:
    assert bench.send(b"Q\r") == b"."
    assert bench.send(b"QP5QP7\r") == b"\x96\x00"
    bench.send(b"#5P1600T1000\r")
    assert bench.send(b"Q\r") == b"+"
    bench.wait(1.0)
    assert bench.send(b"q\rqp5\r") == b".\xa0"


def test_stop_stays_where_nobody_has_recorded_it(bench: Bench) -> None:
    bench.send(b"#5P1600T1000\r")
    bench.wait(0.3)
    bench.send(b"STOP 5\r")
    bench.wait(5.0)
    assert 1520 < bench.pulse_us(5) < 1560


@pytest.mark.parametrize("off", [b"#5L\r", b"#5P0\r"])
def test_off_lets_go_and_the_next_move_jumps(bench: Bench, off: bytes) -> None:
    bench.send(off)
    assert bench.send(b"QP5QP6\r") == b"\x00\x96"
    bench.send(b"#5P1900T5000\r")
    assert bench.pulse_us(5) == 1900


def test_an_offset_shifts_the_pulse_and_not_the_answer(bench: Bench) -> None:
    bench.send(b"#5PO-20\r#5P1500T20\r")
    bench.wait(1.0)
    assert bench.pulse_us(5) == 1480
    assert bench.send(b"QP5\r") == b"\x96"


FRAME = b"#5P1610#6P1620T55\r"


@pytest.mark.parametrize("kept", range(1, len(FRAME) - 1))
def test_a_cut_line_swallows_or_spoils_the_next_one_unless_it_is_cancelled(bench: Bench, kept: int) -> None:
    bench.send(FRAME[:kept] + b"#5P1510#6P1520T55\r")
    bench.wait(1.0)
    assert bench.pulse_us(5) in (1500, 1510)
    bench.send(FRAME[:kept] + b"\x1b\r" + b"#5P1530#6P1540T55\r")
    bench.wait(1.0)
    assert (bench.pulse_us(5), bench.pulse_us(6)) == (1530, 1540)


@pytest.mark.parametrize("line", [b"VER\r", b"VA\r", b"hello\r", b"#40P1500\r", b"#5P3000\r", b"\r\r"])
def test_what_it_does_not_do_changes_nothing(bench: Bench, line: bytes) -> None:
    assert bench.send(line) == b""
    assert bench.pulse_us(5) == 1500
