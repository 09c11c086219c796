# SPDX-License-Identifier: Apache-2.0
"""Lengths as the whole pulses that are sent, the same however the lengths were computed."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardware_bridge.calibration.pulse_map import Calibration

_NUDGE_US = 1e-6
"""Added before rounding, so that a length that lies on the edge of a pulse does not flicker with its last bit."""


@lru_cache(maxsize=8)
def _lines(calibration: Calibration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pulse at zero stroke in [us], and slope in [us/mm] with its sign, (6,) each."""
    struts = calibration.struts
    zero_us = np.array([strut.pulse_at_zero_us + strut.trim_us for strut in struts], dtype=float)
    return zero_us, np.array([strut.direction * strut.us_per_mm for strut in struts], dtype=float)


def exact_pulses_us(calibration: Calibration, lengths_m: ArrayLike) -> NDArray[np.float64]:
    """Pulses in [us], not rounded, for rest lengths in [m]. Shape (..., 6), as given."""
    zero_us, slope = _lines(calibration)
    return zero_us + slope * ((np.asarray(lengths_m, dtype=float) - calibration.mid_stroke_length_m) * 1e3)


def whole(pulses_us: ArrayLike) -> NDArray[np.int64]:
    """The nearest whole pulses in [us]; halves go up."""
    return np.floor(np.asarray(pulses_us, dtype=float) + (0.5 + _NUDGE_US)).astype(np.int64)


def rounded_m(calibration: Calibration, lengths_m: ArrayLike) -> NDArray[np.float64]:
    """The rest lengths in [m] that the nearest whole pulses really ask for. Shape (..., 6), as given."""
    zero_us, slope = _lines(calibration)
    pulses_us = whole(exact_pulses_us(calibration, lengths_m))
    return np.asarray(calibration.mid_stroke_length_m + (pulses_us - zero_us) / slope * 1e-3)
