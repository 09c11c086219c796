# SPDX-License-Identifier: Apache-2.0
"""Limits applied: to a whole trajectory before it is accepted, and to every frame before it becomes bytes.

The two are written separately on purpose: a mistake in one does not open the other.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.calibration.whole_pulses import rounded_m
from hardware_bridge.errors import LimitError, ShapeError, TrajectoryError
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.path_extremes import most_hasty, points_along
from hardware_bridge.safety.shape_cache import NO_LOADS, Loads, ShapeCheck
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

SHAPE_STEP_M = 1e-3
"""No strut changes by more between two shapes that are judged along a path."""

MOST_SHAPES = 16000
"""Shapes of one path: more than 600 s at 20 mm/s have, one a mm. Each takes the judge some ms."""

_ROUNDING_M = 1e-9


def any_shape(_lengths_m: tuple[float, ...]) -> str | None:
    """The shape check of somebody who has none."""
    return None


def no_loads(_lengths_m: tuple[float, ...]) -> Loads:
    """The loads of somebody who knows no forces."""
    return NO_LOADS


@dataclass(frozen=True)
class Rules:
    """Everything that decides whether a command or frame is permitted.

    Attributes:
        calibration: of the six struts; its own limits hold always, also while homing.
        limits: of commands.
        pacing: of frames.
        shape_check: judges six rest lengths together; applied to every mm of every path, and to every frame.
        loads: which struts are held against more than their back-drive force at six rest lengths; asked at every frame.
    """

    calibration: Calibration
    limits: Limits = field(default_factory=Limits)
    pacing: Pacing = field(default_factory=Pacing)
    shape_check: ShapeCheck = any_shape
    loads: Callable[[tuple[float, ...]], Loads] = no_loads


def check_trajectory(rules: Rules, present_m: Sequence[float], trajectory: Trajectory) -> Trajectory:
    """The trajectory from the present lengths on, if all of it is permitted.

    The verdict is on the path and not on its knots: as many more of them on the same straight lines change nothing. Lengths are
    whole pulses in the end, so over any span of time a strut may change by one pulse more than its speed permits: one in all, not
    one a knot.

    Raises:
        LimitError, ShapeError, TrajectoryError: the first thing that is not, with strut, value and limit.
    """
    limits = rules.limits
    for knot in _beyond(rules, trajectory.lengths_m, limits.stroke_m):
        _check_stroke(rules, trajectory.lengths_m[knot], limits.stroke_m, f"at knot {knot + 1}")
    quanta_m = np.array([strut.quantum_m for strut in rules.calibration.struts])
    if trajectory.times_s[0] == 0.0:
        for name, asked, present, quantum in zip(STRUT_NAMES, trajectory.lengths_m[0], present_m, quanta_m, strict=True):
            if abs(asked - present) > quantum + _ROUNDING_M:
                where = f"from the present {present:.4f} m at knot 1, time 0; start where the strut is"
                raise LimitError(name, "jump", abs(asked - present) * 1e3, quantum * 1e3, "mm", where)
    path = trajectory.starting_at(present_m)
    _check_haste(path, "speed", "mm/s", limits.speed_m_s, 1.0, quanta_m)
    # A frame is one period: who stays below a step in each never needs a larger one.
    _check_haste(path, "step of a frame", "mm", limits.step_m / rules.pacing.period_s, rules.pacing.period_s, quanta_m)
    check_shapes(rules, path)
    return path


def _check_haste(path: Trajectory, quantity: str, unit: str, speed_m_s: float, span_s: float, quanta_m: np.ndarray) -> None:
    """Raises LimitError, in changes per `span_s`, if a strut is anywhere more than its quantum ahead of a speed."""
    haste = most_hasty(path, speed_m_s * (1 + 1e-6), quanta_m + _ROUNDING_M)
    if haste.over_m > quanta_m[haste.strut] + _ROUNDING_M:
        change_mm = haste.change_m / max(haste.end_s - haste.start_s, 1e-9) * span_s * 1e3
        where = f"from {haste.start_s:.3f} to {haste.end_s:.3f} s"
        raise LimitError(STRUT_NAMES[haste.strut], quantity, change_mm, speed_m_s * span_s * 1e3, unit, where)


def check_homing(rules: Rules, pulses_us: Sequence[int], path: Trajectory) -> None:
    """Homing may start outside the policy bound, but not outside the actuators' own, nor go through a bad shape.

    Raises:
        LimitError, ShapeError: with strut, value and limit.
    """
    _check_pulses(rules, range(len(STRUT_NAMES)), pulses_us)
    _check_stroke(rules, rules.calibration.lengths_m(pulses_us), np.inf, "before homing")
    check_shapes(rules, path)


def check_shapes(rules: Rules, path: Trajectory) -> None:
    """Both ends of a path, every mm of its way and every turn of a strut, as whole pulses would have it.

    Raises:
        ShapeError: the first shape that is not permitted, with its time.
        TrajectoryError: the way is too long to be judged.
    """
    points = points_along(path, SHAPE_STEP_M, MOST_SHAPES)
    if points is None:
        longest_m = MOST_SHAPES * SHAPE_STEP_M
        raise TrajectoryError(
            f"its way and its turns have more than {MOST_SHAPES} shapes (about {longest_m:g} m); send it in parts"
        )
    for time_s, lengths_m in zip(points[0], rounded_m(rules.calibration, points[1]).tolist(), strict=True):
        problem = rules.shape_check(tuple(lengths_m))
        if isinstance(problem, str):
            raise ShapeError(tuple(lengths_m), problem, f"at {time_s:.2f} s")


def check_frame(
    rules: Rules,
    struts: Sequence[int],
    pulses_us: Sequence[int],
    previous_us: Sequence[int | None],
    duration_ms: int,
    homing: bool,
    board_us: Sequence[float | None] | None = None,
    hold: bool = False,
) -> None:
    """The last gate before bytes: sees only pulses, those to be sent, those sent before, and where the board is by these.

    No strut may be asked to go faster than the limit from where the board is, whatever was sent to it before. A frame that
    repeats every pulse (energise) moves nothing, and a hold goes nowhere new: they are held to that and to the pulse limits only.

    Args:
        rules: limits and calibration.
        struts: indices (from 0) of the struts in the frame.
        pulses_us: all six pulses after the frame.
        previous_us: all six before it; None where not known.
        duration_ms: duration asked of the board.
        homing: the policy's stroke limit does not hold yet; everything else does.
        board_us: the six pulses that the board gives now, see `BoardTrack`; None for a strut that it was not sent since the port
            was opened. None: where it was sent before.
        hold: the frame is to stop the struts: it must lie between where the board is and where it was sent.

    Raises:
        LimitError, ShapeError: the frame must not be sent.
    """
    calibration, limits = rules.calibration, rules.limits
    _check_pulses(rules, struts, pulses_us)
    repeats = tuple(pulses_us) == tuple(previous_us)
    for index in struts:
        name, strut, pulse, before = STRUT_NAMES[index], calibration.struts[index], pulses_us[index], previous_us[index]
        at_us = before if board_us is None else board_us[index]
        if before is None or (at_us is None and pulse != before):
            raise LimitError(name, "step from an unknown position", np.nan, limits.step_m * 1e3, "mm")
        way_m = 0.0 if at_us is None else abs(pulse - at_us) * strut.quantum_m
        if not way_m <= limits.speed_m_s * duration_ms * 1e-3 + strut.quantum_m + _ROUNDING_M:
            raise LimitError(name, "speed", way_m * 1e6 / duration_ms, limits.speed_m_s * 1e3, "mm/s", "in a frame")
        if hold and at_us is not None and not min(at_us, before) - 1 <= pulse <= max(at_us, before) + 1:
            raise LimitError(name, "pulse of a hold", pulse, at_us, "us")
        if hold or repeats:
            continue
        stroke_m = strut.pulse_to_stroke(pulse)
        bound_m = np.inf if homing else limits.stroke_m
        _check_one_stroke(rules, index, stroke_m, bound_m, strut.quantum_m, "in a frame")
        step_m = abs(stroke_m - strut.pulse_to_stroke(before))
        if not step_m <= limits.step_m + strut.quantum_m + _ROUNDING_M:
            raise LimitError(name, "step of a frame", step_m * 1e3, limits.step_m * 1e3, "mm")
    if hold or repeats:
        return
    lengths_m = calibration.lengths_m(pulses_us)
    problem = rules.shape_check(lengths_m)
    if isinstance(problem, str):
        raise ShapeError(lengths_m, problem, "in a frame")


def _beyond(rules: Rules, lengths_m: np.ndarray, bound_m: float) -> list[int]:
    """Rows (from 0) with a stroke that may be outside its limits, the first such only."""
    struts = rules.calibration.struts
    low_m = np.array([max(-bound_m, strut.stroke_mm[0] * 1e-3) for strut in struts])
    high_m = np.array([min(bound_m, strut.stroke_mm[1] * 1e-3) for strut in struts])
    strokes_m = lengths_m - rules.calibration.mid_stroke_length_m
    out = ~((strokes_m >= low_m - _ROUNDING_M) & (strokes_m <= high_m + _ROUNDING_M)).all(axis=1)
    return [int(np.argmax(out))] if out.any() else []


def _check_pulses(rules: Rules, struts: Iterable[int], pulses_us: Sequence[int]) -> None:
    for index in struts:
        pulse, (low, high) = pulses_us[index], rules.calibration.struts[index].pulse_us
        if not low <= pulse <= high:
            raise LimitError(STRUT_NAMES[index], "pulse", pulse, low if pulse < low else high, "us")


def _check_stroke(rules: Rules, lengths_m: Sequence[float], bound_m: float, where: str) -> None:
    for index, length_m in enumerate(lengths_m):
        _check_one_stroke(rules, index, length_m - rules.calibration.mid_stroke_length_m, bound_m, 0.0, where)


def _check_one_stroke(rules: Rules, index: int, stroke_m: float, bound_m: float, tolerance_m: float, where: str) -> None:
    low_mm, high_mm = rules.calibration.struts[index].stroke_mm
    low_m, high_m = max(-bound_m, low_mm * 1e-3), min(bound_m, high_mm * 1e-3)
    tolerance_m += _ROUNDING_M
    if not low_m - tolerance_m <= stroke_m <= high_m + tolerance_m:
        limit_m = low_m if stroke_m < low_m else high_m
        raise LimitError(STRUT_NAMES[index], "stroke", stroke_m * 1e3, limit_m * 1e3, "mm", where)
