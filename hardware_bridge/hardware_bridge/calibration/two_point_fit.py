# SPDX-License-Identifier: Apache-2.0
"""From what a person measured on one strut to its calibration. Pure numbers; no port, no screen."""

import math
from dataclasses import dataclass

from hardware_bridge.calibration.calibration_file import parse_strut
from hardware_bridge.calibration.pulse_map import StrutCalibration
from hardware_bridge.errors import CalibrationError

NOMINAL_PULSE_US = 1500
TRIM_LIMIT_US = 100
SHORTEST_TRAVEL_MM = 10.0
"""Between the two end points; with less, a millimetre misread is a tenth of the slope."""
RESIDUAL_LIMIT_MM = 1.5
"""How far the length measured at mid stroke may be from the line through the ends."""


@dataclass(frozen=True)
class Measured:
    """One reading: pulse in [us], length from node to node in [mm]."""

    pulse_us: int
    length_mm: float


def slope_us_per_mm(strut: str, short: Measured, long: Measured) -> float:
    """Change of pulse per mm of length, negative if a longer pulse shortens the strut.

    Raises:
        CalibrationError: the readings give no plausible slope.
    """
    travel_mm = long.length_mm - short.length_mm
    if travel_mm < SHORTEST_TRAVEL_MM or short.pulse_us == long.pulse_us:
        got = f"{short.length_mm:g} mm at {short.pulse_us} us and {long.length_mm:g} mm at {long.pulse_us} us"
        raise CalibrationError("measured", f"{got}: the ends must be {SHORTEST_TRAVEL_MM:g} mm or more apart; measure again", strut)
    return (long.pulse_us - short.pulse_us) / travel_mm


def pulse_at_mm(strut: str, short: Measured, long: Measured, length_mm: float) -> int:
    """Pulse at which the line through both ends has this length. Raises CalibrationError: it lies outside the ends."""
    slope = slope_us_per_mm(strut, short, long)
    if not short.length_mm < length_mm < long.length_mm:
        ends = f"{short.length_mm:g} to {long.length_mm:g} mm"
        raise CalibrationError("measured", f"mid stroke, {length_mm:g} mm, is not between the ends, {ends}; measure again", strut)
    return round(short.pulse_us + slope * (length_mm - short.length_mm))


def check_straight(strut: str, short: Measured, long: Measured, middle: Measured) -> None:
    """Raises CalibrationError: the third reading is not on the line through the other two."""
    expected_mm = short.length_mm + (middle.pulse_us - short.pulse_us) / slope_us_per_mm(strut, short, long)
    if abs(middle.length_mm - expected_mm) > RESIDUAL_LIMIT_MM:
        problem = f"{middle.length_mm:g} mm at {middle.pulse_us} us, the line through the ends gives {expected_mm:.1f} mm"
        raise CalibrationError("measured", f"{problem}; valid is within {RESIDUAL_LIMIT_MM:g} mm, measure again", strut)


def fit(strut: str, channel: int, short: Measured, long: Measured, zero_pulse_us: int) -> StrutCalibration:
    """One strut's calibration, of two points near its ends and the pulse at which it was seen to be at mid stroke.

    Raises:
        CalibrationError: not plausible, with what is valid.
    """
    slope = slope_us_per_mm(strut, short, long)
    offset_us = zero_pulse_us - NOMINAL_PULSE_US
    trimmed = abs(offset_us) <= TRIM_LIMIT_US
    per_mm = round(abs(slope), 3)
    low_mm = math.ceil(10.0 * (short.pulse_us - zero_pulse_us) / math.copysign(per_mm, slope)) / 10.0
    high_mm = math.floor(10.0 * (long.pulse_us - zero_pulse_us) / math.copysign(per_mm, slope)) / 10.0
    data = {
        "channel": channel,
        "pulse_at_zero_us": NOMINAL_PULSE_US if trimmed else zero_pulse_us,
        "us_per_mm": per_mm,
        "direction": 1 if slope > 0 else -1,
        "trim_us": offset_us if trimmed else 0,
        "stroke_mm": [low_mm, high_mm],
        "pulse_us": sorted((short.pulse_us, long.pulse_us)),
    }
    return parse_strut("measured", strut, data)
