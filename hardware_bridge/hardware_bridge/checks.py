"""Limits applied: to a whole trajectory before it is accepted, and to every frame before it becomes bytes.

The two are written separately on purpose: a mistake in one does not open the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hardware_bridge.calibration import STRUTS, Calibration
from hardware_bridge.errors import LimitError, ShapeError
from hardware_bridge.limits import Limits, Pacing
from hardware_bridge.shape_memory import ShapeCheck
from hardware_bridge.trajectory import Trajectory

START_TOLERANCE_M = 5e-4
"""How far a knot at time 0 may be from the present lengths."""

SHAPE_STEP_M = 1e-3
"""No strut changes by more between two shapes that are judged along a path."""

_ROUNDING_M = 1e-9


def any_shape(lengths_m: tuple[float, ...]) -> str | None:
    """The shape check of somebody who has none."""
    return None


@dataclass(frozen=True)
class Rules:
    """Everything that decides whether a command or frame is permitted.

    Attributes:
        calibration: Of the six struts; its own limits hold always, also while homing.
        limits: Of commands.
        pacing: Of frames.
        shape_check: Judges six rest lengths together; applied to every mm of every path, and to every frame.
    """

    calibration: Calibration
    limits: Limits = field(default_factory=Limits)
    pacing: Pacing = field(default_factory=Pacing)
    shape_check: ShapeCheck = any_shape


def check_trajectory(rules: Rules, present_m: Sequence[float], trajectory: Trajectory) -> Trajectory:
    """The trajectory from the present lengths on, if all of it is permitted.

    Raises:
        LimitError, ShapeError: The first thing that is not, with strut, value and limit.
    """
    limits = rules.limits
    for knot, row in enumerate(trajectory.lengths_m, start=1):
        _check_stroke(rules, row, limits.stroke_m, f"at knot {knot}")
    if trajectory.times_s[0] == 0.0:
        for name, asked, present in zip(STRUTS, trajectory.lengths_m[0], present_m, strict=True):
            if abs(asked - present) > START_TOLERANCE_M:
                where = f"from the present {present:.4f} m at knot 1, time 0; start where the strut is"
                raise LimitError(name, "jump", abs(asked - present) * 1e3, START_TOLERANCE_M * 1e3, "mm", where)
    path = trajectory.starting_at(present_m)
    quanta_m = np.array([strut.quantum_m for strut in rules.calibration.struts])
    changes = np.abs(np.diff(path.lengths_m, axis=0))
    for segment, (dt_s, change) in enumerate(zip(np.diff(path.times_s), changes, strict=True), start=1):
        where = f"in segment {segment}"
        for index, name in enumerate(STRUTS):
            # Lengths are whole pulses: over a short time a quantum more is no speed.
            if change[index] > limits.speed_m_s * dt_s * (1 + 1e-6) + quanta_m[index]:
                raise LimitError(name, "speed", change[index] / dt_s * 1e3, limits.speed_m_s * 1e3, "mm/s", where)
            step_m = change[index] * min(1.0, rules.pacing.period_s / dt_s)
            if step_m > limits.step_m + _ROUNDING_M:
                raise LimitError(name, "step of a frame", step_m * 1e3, limits.step_m * 1e3, "mm", where)
    check_shapes(rules, path)
    return path


def check_homing(rules: Rules, pulses_us: Sequence[int], path: Trajectory) -> None:
    """Homing may start outside the policy bound, but not outside the actuators' own, nor go through a bad shape.

    Raises:
        LimitError, ShapeError: With strut, value and limit.
    """
    _check_pulses(rules, range(len(STRUTS)), pulses_us)
    _check_stroke(rules, rules.calibration.lengths_m(pulses_us), np.inf, "before homing")
    check_shapes(rules, path)


def check_shapes(rules: Rules, path: Trajectory) -> None:
    """Every knot, and every mm between, as whole pulses would have it.

    Raises:
        ShapeError: The first shape that is not permitted, with its time.
    """
    steps = np.ceil(np.abs(np.diff(path.lengths_m, axis=0)).max(axis=1) / SHAPE_STEP_M - _ROUNDING_M).astype(int)
    ends = zip(path.times_s, path.times_s[1:], np.maximum(steps, 1), strict=False)
    between = [np.linspace(start_s, end_s, count, endpoint=False) for start_s, end_s, count in ends]
    for time_s in np.concatenate([*between, path.times_s[-1:]]):
        lengths_m = rules.calibration.lengths_m(rules.calibration.pulses_us(list(path.at(time_s))))
        problem = rules.shape_check(lengths_m)
        if problem is not None:
            raise ShapeError(lengths_m, problem, f"at {time_s:.2f} s")


def check_frame(
    rules: Rules,
    struts: Sequence[int],
    pulses_us: Sequence[int],
    previous_us: Sequence[int | None],
    duration_ms: int,
    homing: bool,
) -> None:
    """The last gate before bytes: sees only pulses, those to be sent and those sent before.

    A frame that repeats every pulse (energise, hold) moves nothing and is held to the pulse limits only.

    Args:
        struts: Indices (from 0) of the struts in the frame.
        pulses_us: All six pulses after the frame.
        previous_us: All six before it; None where not known.
        duration_ms: Duration asked of the board.
        homing: The policy's stroke limit does not hold yet; everything else does.

    Raises:
        LimitError, ShapeError: The frame must not be sent.
    """
    calibration, limits = rules.calibration, rules.limits
    _check_pulses(rules, struts, pulses_us)
    if tuple(pulses_us) == tuple(previous_us):
        return
    for index in struts:
        name, strut, pulse, before = STRUTS[index], calibration.struts[index], pulses_us[index], previous_us[index]
        stroke_m = strut.pulse_to_stroke(pulse)
        bound_m = np.inf if homing else limits.stroke_m
        _check_one_stroke(rules, index, stroke_m, bound_m, strut.quantum_m, "in a frame")
        if before is None:
            raise LimitError(name, "step from an unknown position", np.nan, limits.step_m * 1e3, "mm")
        step_m = abs(stroke_m - strut.pulse_to_stroke(before))
        if step_m > limits.step_m + strut.quantum_m + _ROUNDING_M:
            raise LimitError(name, "step of a frame", step_m * 1e3, limits.step_m * 1e3, "mm")
        if step_m > limits.speed_m_s * duration_ms * 1e-3 + strut.quantum_m + _ROUNDING_M:
            raise LimitError(name, "speed", step_m * 1e6 / duration_ms, limits.speed_m_s * 1e3, "mm/s", "in a frame")
    lengths_m = calibration.lengths_m(pulses_us)
    problem = rules.shape_check(lengths_m)
    if problem is not None:
        raise ShapeError(lengths_m, problem, "in a frame")


def _check_pulses(rules: Rules, struts: Iterable[int], pulses_us: Sequence[int]) -> None:
    for index in struts:
        pulse, (low, high) = pulses_us[index], rules.calibration.struts[index].pulse_us
        if not low <= pulse <= high:
            raise LimitError(STRUTS[index], "pulse", pulse, low if pulse < low else high, "us")


def _check_stroke(rules: Rules, lengths_m: Sequence[float], bound_m: float, where: str) -> None:
    for index, length_m in enumerate(lengths_m):
        _check_one_stroke(rules, index, length_m - rules.calibration.mid_stroke_length_m, bound_m, 0.0, where)


def _check_one_stroke(rules: Rules, index: int, stroke_m: float, bound_m: float, tolerance_m: float, where: str) -> None:
    low_mm, high_mm = rules.calibration.struts[index].stroke_mm
    low_m, high_m = max(-bound_m, low_mm * 1e-3), min(bound_m, high_mm * 1e-3)
    tolerance_m += _ROUNDING_M
    if not low_m - tolerance_m <= stroke_m <= high_m + tolerance_m:
        limit_m = low_m if stroke_m < low_m else high_m
        raise LimitError(STRUTS[index], "stroke", stroke_m * 1e3, limit_m * 1e3, "mm", where)
