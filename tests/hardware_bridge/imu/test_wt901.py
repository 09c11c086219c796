# SPDX-License-Identifier: Apache-2.0
"""WT901: golden bytes by the datasheet's formulas, and any bytes between them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.imu.wt901 import (
    ACCELERATION,
    ANGLES,
    QUATERNION,
    RATE,
    Frame,
    FrameDecoder,
    Measurement,
    Rounds,
    encode_frame,
    frames_of,
)

# 1 g up (2048 of 32768 at 16 g), 25.00 °C; 100 °/s about x (1638 of 32768 at 2000 °/s); a quarter of a turn about z
GOLDEN = {
    ACCELERATION: (bytes.fromhex("55 51 00 00 00 00 00 08 C4 09 7B"), (0, 0, 2048, 2500)),
    RATE: (bytes.fromhex("55 52 66 06 00 00 00 00 C4 09 E0"), (1638, 0, 0, 2500)),
    ANGLES: (bytes.fromhex("55 53 00 00 00 00 00 40 2A 46 58"), (0, 0, 16384, 17962)),
    QUATERNION: (bytes.fromhex("55 59 82 5A 00 00 00 00 82 5A 66"), (23170, 0, 0, 23170)),
}
words = st.integers(-32768, 32767)


@pytest.mark.parametrize("kind", GOLDEN)
def test_golden_bytes_there_and_back(kind):
    data, numbers = GOLDEN[kind]
    assert encode_frame(kind, numbers) == data
    assert FrameDecoder().feed(data) == [Frame(kind, numbers)]


def test_a_round_is_told_in_si_units():
    rounds, decoder = Rounds(), FrameDecoder()
    stream = b"".join(data for data, _ in GOLDEN.values()) + GOLDEN[ACCELERATION][0]
    (found,) = [told for frame in decoder.feed(stream) if (told := rounds.take(frame))]
    assert found.acceleration_m_s2 == pytest.approx((0.0, 0.0, 9.80665))
    assert found.rate_rad_s == pytest.approx((math.radians(99.98), 0.0, 0.0), rel=1e-3)
    assert found.quaternion == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), abs=1e-4)


def test_a_round_without_its_rates_is_left_out_and_one_without_quaternion_is_not():
    rounds = Rounds()
    assert rounds.take(Frame(ACCELERATION, (0, 0, 2048, 0))) is None
    assert rounds.take(Frame(ACCELERATION, (0, 0, 2048, 0))) is None
    assert rounds.take(Frame(RATE, (0, 0, 0, 0))) is None
    told = rounds.take(Frame(ACCELERATION, (0, 0, 2048, 0)))
    assert told is not None
    assert told.quaternion is None


@given(
    st.lists(st.tuples(st.binary(max_size=12), st.sampled_from(list(GOLDEN)), st.tuples(words, words, words, words)), max_size=8),
    st.data(),
)
def test_frames_are_found_among_any_bytes_whatever_the_pieces(parts, data):
    """Strange bytes may swallow a frame that looks like their continuation, or look like one; all others are found."""
    sent = [Frame(kind, numbers) for _, kind, numbers in parts]
    stream = b"".join(bytes(b for b in junk if b != 0x55) + encode_frame(kind, numbers) for junk, kind, numbers in parts)
    decoder, found, at = FrameDecoder(), [], 0
    while at < len(stream):
        step = data.draw(st.integers(1, 40))
        found += decoder.feed(stream[at : at + step])
        at += step
    assert found == sent


@given(st.binary(max_size=400))
def test_any_bytes_are_survived_and_counted(data):
    decoder = FrameDecoder()
    frames = decoder.feed(data)
    assert 11 * len(frames) + decoder.bad <= len(data)


@pytest.mark.parametrize("bit", range(88))
def test_a_flipped_bit_is_no_measurement(bit):
    data = bytearray(GOLDEN[RATE][0])
    data[bit // 8] ^= 1 << bit % 8
    assert FrameDecoder().feed(bytes(data)) == []


def test_what_is_beyond_the_range_saturates():
    told = frames_of(Measurement((400.0, 0.0, -400.0), (100.0, 0.0, 0.0)))
    one, other = FrameDecoder().feed(told)
    assert (one.words[:3], other.words[0]) == ((32767, 0, -32768), 32767)


def test_what_is_no_frame_is_refused():
    with pytest.raises(ValueError, match=r"type 0x60: valid is 0x50 to 0x5a"):
        encode_frame(0x60, (0, 0, 0, 0))
    with pytest.raises(ValueError, match="valid is -32768 to 32767"):
        encode_frame(0x51, (40000, 0, 0, 0))
