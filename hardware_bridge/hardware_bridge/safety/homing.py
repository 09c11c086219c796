# SPDX-License-Identifier: Apache-2.0
"""Where the struts are before anything moves, and the slow way to mid stroke."""

import math

import numpy as np

from hardware_bridge.errors import PositionUnknown
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.supervisor_messages import Arm, State
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

CONFIRMATION_TOLERANCE_M = 0.002
"""How far the operator's word may be from the record of the last write before one of them must be wrong."""


def known_pulses(rules: Rules, state: State, arm: Arm) -> tuple[int, ...]:
    """The pulse at which each strut is: as last sent, or else as the operator confirms.

    Raises:
        PositionUnknown: neither is known, or they disagree, naming the strut.
    """
    if len(arm.confirmed_lengths_m) != len(STRUT_NAMES):
        raise PositionUnknown("S1 to S6", f"{len(arm.confirmed_lengths_m)} confirmed lengths, valid are 0 or 6")
    calibration = rules.calibration
    pulses_us = []
    for index, (recorded_us, told_m) in enumerate(zip(state.pulses_us, arm.confirmed_lengths_m, strict=True)):
        confirmed_m = told_m if told_m is not None and math.isfinite(told_m) else None
        if recorded_us is None:
            if confirmed_m is None:
                why = f": {state.unknown_why}" if state.unknown_why else ""
                remedy = "look where each strut is, and confirm the six lengths in m with arm"
                raise PositionUnknown(STRUT_NAMES[index], f"nobody knows its length{why}; {remedy}")
            pulses_us.append(calibration.pulse_us(index, confirmed_m))
            continue
        recorded_m = calibration.length_m(index, recorded_us)
        if confirmed_m is not None and abs(recorded_m - confirmed_m) > CONFIRMATION_TOLERANCE_M:
            problem = f"was last sent {recorded_m:.4f} m, but {confirmed_m:.4f} m is confirmed"
            remedy = "arm without confirming to trust the record, or delete the last-pulses file"
            raise PositionUnknown(STRUT_NAMES[index], f"{problem}; {remedy}")
        pulses_us.append(recorded_us)
    return tuple(pulses_us)


def homing_path(rules: Rules, pulses_us: tuple[int, ...]) -> Trajectory:
    """From `pulses_us` to mid stroke, all struts arriving together, the farthest at homing speed."""
    present_m = rules.calibration.lengths_m(pulses_us)
    mid_m = rules.calibration.mid_stroke_length_m
    way_m = max(abs(length_m - mid_m) for length_m in present_m)
    speed_m_s = min(rules.pacing.homing_speed_m_s, rules.limits.speed_m_s)
    duration_s = max(rules.pacing.period_s, way_m / speed_m_s)
    return Trajectory(np.array([0.0, duration_s]), np.array([present_m, [mid_m] * len(STRUT_NAMES)]))
