# SPDX-License-Identifier: Apache-2.0
"""From readings to a strut's calibration."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.calibration.two_point_fit import Measured, check_straight, fit, pulse_at_mm
from hardware_bridge.errors import CalibrationError


def test_a_plain_actuator_with_a_trim() -> None:
    short, long = Measured(1050, 189.0), Measured(1950, 279.0)
    assert pulse_at_mm("S1", short, long, 234.0) == 1500
    strut = fit("S1", 1, short, long, 1507)
    assert (strut.pulse_at_zero_us, strut.trim_us, strut.direction, strut.us_per_mm) == (1500, 7, 1, 10.0)
    assert strut.pulse_us == (1050, 1950)
    assert strut.stroke_mm == (-45.7, 44.3)


def test_an_actuator_that_works_the_other_way_round() -> None:
    strut = fit("S2", 2, Measured(1900, 190.0), Measured(1100, 278.0), 1500)
    assert strut.direction == -1
    assert strut.us_per_mm == pytest.approx(800 / 88, abs=1e-3)
    assert strut.stroke_to_pulse(0.040) < 1500 < strut.stroke_to_pulse(-0.040)


def test_a_large_offset_is_no_trim() -> None:
    strut = fit("S1", 1, Measured(1150, 189.0), Measured(2050, 279.0), 1600 + 40)
    assert (strut.pulse_at_zero_us, strut.trim_us) == (1640, 0)


@pytest.mark.parametrize(
    ("short", "long", "says"),
    [
        (Measured(1500, 234.0), Measured(1550, 239.0), "must be 10 mm or more apart"),
        (Measured(1050, 279.0), Measured(1950, 189.0), "must be 10 mm or more apart"),
        (Measured(1500, 189.0), Measured(1500, 279.0), "must be 10 mm or more apart"),
        (Measured(1050, 240.0), Measured(1950, 279.0), "mid stroke, 234 mm, is not between the ends"),
    ],
)
def test_readings_that_make_no_sense_are_refused(short: Measured, long: Measured, says: str) -> None:
    with pytest.raises(CalibrationError, match=says) as caught:
        pulse_at_mm("S4", short, long, 234.0)
    assert caught.value.strut == "S4"


def test_a_reading_off_the_line_is_refused() -> None:
    short, long = Measured(1050, 189.0), Measured(1950, 279.0)
    check_straight("S1", short, long, Measured(1500, 235.0))
    with pytest.raises(CalibrationError, match=r"the line through the ends gives 234\.0 mm"):
        check_straight("S1", short, long, Measured(1500, 236.0))


@given(
    zero_us=st.integers(1350, 1650),
    per_mm=st.floats(7.0, 13.0),
    direction=st.sampled_from([-1, 1]),
    reach_us=st.integers(300, 500),
)
def test_a_fit_gives_back_the_actuator_and_its_limits_hold(zero_us: int, per_mm: float, direction: int, reach_us: int) -> None:
    def reading(pulse_us: int) -> Measured:
        return Measured(pulse_us, 234.0 + (pulse_us - zero_us) / (direction * per_mm))

    short, long = reading(zero_us - direction * reach_us), reading(zero_us + direction * reach_us)
    strut = fit("S3", 3, short, long, pulse_at_mm("S3", short, long, 234.0))
    for stroke_mm in (*strut.stroke_mm, 0.0, 12.3):
        pulse = strut.stroke_to_pulse(stroke_mm * 1e-3)
        assert pulse == pytest.approx(zero_us + direction * per_mm * stroke_mm, abs=1.1)
        assert strut.pulse_us[0] <= pulse <= strut.pulse_us[1]
