# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from hardware_bridge.boards import maestro as m
from hardware_bridge.boards.maestro import SET_MULTIPLE, Maestro
from hardware_bridge.virtual_prototype.boards.maestro import ControlCenter, EmulatedMaestro
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Outputs

OFF, TO_1200 = ControlCenter(home_us=0.0), ControlCenter(home_us=1200.0)


class Bench:
    """A board on a table: bytes in, replies and pulses out."""

    def __init__(self, codec: Maestro, settings: ControlCenter | None = None) -> None:
        self.codec = codec
        self.board = EmulatedMaestro(codec, settings=settings)
        self.outputs = Outputs()
        self.now_s = 0.0

    def send(self, data: bytes) -> bytes:
        self.board.receive(data, self.now_s)
        return self.wait(0.01)

    def wait(self, duration_s: float) -> bytes:
        self.now_s += duration_s
        reply = self.board.process(self.now_s)
        while self.board.orders:
            time_s, order = self.board.orders.popleft()
            self.outputs.follow(order, time_s)
        return reply

    def pulse_us(self, channel: int) -> float:
        return self.outputs.pulse_us(channel, self.now_s)

    def errors(self) -> tuple[str, ...]:
        return m.decode_errors(int.from_bytes(self.send(self.codec.packet(m.GET_ERRORS)), "little"))


VARIANTS = [Maestro(), Maestro(12), Maestro(crc=True), Maestro(12, True)]
each_variant = pytest.mark.parametrize("codec", VARIANTS, ids=lambda codec: codec.spec)


@each_variant
def test_it_goes_to_a_target_at_the_channels_speed(codec: Maestro) -> None:
    bench = Bench(codec)
    bench.send(codec.set_speed(1, 4) + codec.set_target(1, 1500))
    assert bench.pulse_us(1) == 1500, "the first target ignores the speed"
    bench.send(codec.set_target(1, 1600))
    assert bench.send(codec.packet(m.GET_MOVING)) == b"\x01"
    bench.wait(0.48)
    assert bench.pulse_us(1) == pytest.approx(1550, abs=2)
    bench.wait(1.0)
    assert bench.send(codec.packet(m.GET_MOVING) + codec.ask_position(1)) == b"\x00" + (6400).to_bytes(2, "little")
    bench.send(codec.set_speed(1, 0) + codec.set_target(1, 1000))
    assert bench.pulse_us(1) == 1000
    assert bench.errors() == ()


@each_variant
def test_multiple_targets_are_one_packet(codec: Maestro) -> None:
    bench = Bench(codec)
    bench.send(codec.packet(SET_MULTIPLE, 2, 1, 0x30, 0x22, 0x40, 0x25))
    assert (bench.pulse_us(1), bench.pulse_us(2)) == (1100, 1200)
    assert bench.errors() == ()


def test_targets_are_clipped_to_the_channels_limits_and_zero_is_off() -> None:
    wide, bench = Bench(Maestro(limits_us=(900, 2100))), Bench(Maestro())
    for each in (wide, bench):
        each.send(bytes.fromhex("84 01 7F 7F"))
    assert (wide.pulse_us(1), bench.pulse_us(1)) == (2100, 2000)
    bench.send(Maestro().set_target(1, 0))
    assert math.isnan(bench.pulse_us(1))
    assert bench.send(Maestro().ask_position(1)) == b"\x00\x00"


@each_variant
@pytest.mark.parametrize(("settings", "there_us"), [(OFF, math.nan), (TO_1200, 1200.0), (ControlCenter(), 1500.0)])
def test_a_cut_packet_is_a_latched_error_that_sends_every_channel_home(
    codec: Maestro, settings: ControlCenter, there_us: float
) -> None:
    bench = Bench(codec, settings)
    bench.send(codec.set_target(1, 1500) + codec.set_target(2, 1500))
    bench.send(codec.set_target(1, 1600)[:-1])
    assert bench.pulse_us(1) == 1500, "not before the next packet"
    bench.send(codec.packet(m.GET_MOVING))
    assert [bench.pulse_us(1), bench.pulse_us(2)] == pytest.approx([there_us] * 2, nan_ok=True)
    assert bench.errors() == ("serial protocol",)
    assert bench.errors() == (), "asking clears"


def test_after_off_the_first_target_is_at_full_speed() -> None:
    bench = Bench(Maestro(), OFF)
    bench.send(Maestro().set_target(1, 1500))
    bench.send(b"\x00")
    assert math.isnan(bench.pulse_us(1))
    bench.send(Maestro().encode_move([1900], [1], 1000, [1500.0]))
    assert bench.pulse_us(1) == 1900


def test_home_is_reached_at_the_channels_speed() -> None:
    bench = Bench(Maestro(), TO_1200)
    bench.send(Maestro().encode_move([1500], [1], 1000, [1500.0]))
    bench.send(Maestro().packet(m.GO_HOME))
    bench.wait(1.0)
    assert bench.pulse_us(1) == pytest.approx(1475, abs=1), "the slowest speed, which the last move has set"
    assert bench.errors() == ()


def test_a_wrong_crc_is_an_error_and_the_packet_is_lost() -> None:
    bench = Bench(Maestro(crc=True))
    bench.send(Maestro(crc=True).set_target(1, 1500))
    frame = bytearray(Maestro(crc=True).set_target(1, 1600))
    frame[2] ^= 1
    bench.send(bytes(frame))
    assert bench.pulse_us(1) == 1500
    assert bench.errors() == ("serial CRC",)


@pytest.mark.parametrize("nonsense", [b"\x00", b"\xb0", b"\x84\x7f\x00\x2e", b"\xaa\x0c\x30", b"\xaa\x0c\x7f"])
def test_nonsense_is_a_protocol_error(nonsense: bytes) -> None:
    bench = Bench(Maestro())
    bench.send(nonsense)
    assert bench.errors() == ("serial protocol",)


def test_a_packet_for_another_device_is_not_its_own() -> None:
    bench = Bench(Maestro(12))
    bench.send(Maestro(13).set_target(1, 1500))
    assert math.isnan(bench.pulse_us(1))
    assert bench.errors() == ()


def test_silence_beyond_the_time_out_is_an_error_that_counts_from_the_last_packet() -> None:
    bench = Bench(Maestro(), ControlCenter(0.0, timeout_s=2.0))
    bench.wait(60.0)
    assert bench.errors() == (), "it does not count before the first packet"
    bench.send(Maestro().set_target(1, 1500))
    bench.wait(1.9)
    assert bench.pulse_us(1) == 1500
    bench.send(Maestro().packet(m.GET_MOVING))
    bench.wait(1.9)
    assert bench.pulse_us(1) == 1500
    bench.wait(0.2)
    assert math.isnan(bench.pulse_us(1))
    assert bench.errors() == ("serial time-out",)


def test_as_delivered_it_has_no_time_out() -> None:
    bench = Bench(Maestro(), OFF)
    bench.send(Maestro().set_target(1, 1500))
    bench.wait(1e5)
    assert bench.pulse_us(1) == 1500


@each_variant
def test_mini_ssc_needs_no_crc_and_spans_less(codec: Maestro) -> None:
    bench = Bench(codec)
    bench.send(bytes.fromhex("FF 01 00 FF 02 7F FF 03 FE"))
    assert [bench.pulse_us(channel) for channel in (1, 2, 3)] == [1023.75, 1500.0, 1976.25]


def test_a_noise_byte_can_swallow_the_beginning_of_a_packet() -> None:
    bench = Bench(Maestro())
    bench.send(b"\xff" + Maestro().set_target(1, 1500))
    assert math.isnan(bench.pulse_us(1))
    assert bench.errors() == ("serial protocol",)
