# SPDX-License-Identifier: Apache-2.0
"""How long each strut has run lately. The actuators' makers permit 20 % of the time; what is counted is what was sent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.calibration.whole_pulses import exact_pulses_us, whole
from hardware_bridge.errors import DutyError
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

_PARTS = 60
"""Spells that a window is counted in; a spell counts until all of it is older than the window, so never too little."""


@dataclass(frozen=True)
class Duty:
    """Robot time that each strut has run, spell by spell.

    Attributes:
        spells: (start in [s] of robot time, time that each of the six struts ran in [s]), oldest first.
    """

    spells: tuple[tuple[float, tuple[float, ...]], ...] = ()

    def ran(self, moved: Sequence[bool], run_s: float, now_s: float, limits: Limits) -> Duty:
        """With `run_s` more for every strut that moved, and without what is too old to count."""
        spell_s = limits.duty_window_s / _PARTS
        spells = [spell for spell in self.spells if spell[0] > now_s - limits.duty_window_s - spell_s]
        more = tuple(run_s * move for move in moved)
        if spells and spells[-1][0] <= now_s < spells[-1][0] + spell_s:
            start_s, before = spells.pop()
            more = tuple(old + new for old, new in zip(before, more, strict=True))
        else:
            start_s = now_s
        return Duty((*spells, (start_s, more)))

    def used_s(self, now_s: float, limits: Limits) -> np.ndarray:
        """Time that each strut ran within the window, in [s]. Shape (6,)."""
        since_s = now_s - limits.duty_window_s - limits.duty_window_s / _PARTS
        return sum((np.array(run_s) for start_s, run_s in self.spells if start_s > since_s), np.zeros(len(STRUT_NAMES)))

    def left_s(self, now_s: float, limits: Limits) -> float:
        """How long the strut that has least left may still run, in [s] of robot time."""
        return max(0.0, limits.duty_s - float(self.used_s(now_s, limits).max()))

    def wait_s(self, needs_s: np.ndarray, now_s: float, limits: Limits) -> float:
        """Rest after which every strut may run for `needs_s` (6,) more, in [s] of robot time."""
        for wait_s in (0.0, *(self._old_in_s(spell[0], now_s, limits) for spell in self.spells)):
            if wait_s >= 0.0 and (self.used_s(now_s + wait_s, limits) + needs_s <= limits.duty_s).all():
                return wait_s
        return limits.duty_window_s

    def _old_in_s(self, start_s: float, now_s: float, limits: Limits) -> float:
        return start_s + limits.duty_window_s * (1.0 + 1.0 / _PARTS) - now_s


def check_duty(duty: Duty, path: Trajectory, now_s: float, rules: Rules) -> None:
    """Whether there is time left for a whole path.

    Raises:
        DutyError: there is not, with strut, time run, limit and how long to wait.
    """
    limits = rules.limits
    needs_s = run_time_s(path, rules.calibration, rules.pacing.period_s)
    used_s = duty.used_s(now_s, limits)
    over = used_s + needs_s > limits.duty_s
    if over.any():
        worst = int(np.argmax(np.where(over, used_s + needs_s, -1.0)))
        wait_s = duty.wait_s(needs_s, now_s, limits) if (needs_s <= limits.duty_s).all() else None
        raise DutyError(
            STRUT_NAMES[worst], float(used_s[worst]), float(needs_s[worst]), limits.duty_s, limits.duty_window_s, wait_s
        )


def run_time_s(path: Trajectory, calibration: Calibration, period_s: float) -> np.ndarray:
    """Robot time in [s] that the frames of a path will be counted to run, at most. Shape (6,).

    A frame counts as one period for each strut whose pulse it changes. Time is cut into periods, and those in which a strut's
    pulse changes are counted; two more a spell of them, because frames come a little late and begin anywhere.
    """
    count = max(1, math.ceil(path.duration_s / period_s - 1e-9))
    edges = np.arange(count + 1) * period_s
    times = np.sort(np.concatenate((edges, path.times_s)))
    first = np.searchsorted(times, edges)
    knots_us = exact_pulses_us(calibration, path.lengths_m)
    needs_s = np.zeros(len(STRUT_NAMES))
    for strut in range(len(STRUT_NAMES)):
        pulses_us = whole(np.interp(times, path.times_s, knots_us[:, strut]))
        ends = pulses_us[first]
        high = np.maximum(np.maximum.reduceat(pulses_us, first)[:-1], ends[1:])
        low = np.minimum(np.minimum.reduceat(pulses_us, first)[:-1], ends[1:])
        runs = high != low
        spells = int(runs[0]) + np.count_nonzero(runs[1:] & ~runs[:-1])
        needs_s[strut] = period_s * (np.count_nonzero(runs) + 2 * spells)
    return needs_s


def returns(path: Trajectory, calibration: Calibration) -> bool:
    """Whether a path only takes struts nearer to mid stroke, where they rest: it is never refused for want of duty or supply.

    In whole pulses, as they are sent, and against the least stroke so far: so nothing adds up, neither from knot to knot nor from
    one motion to the next.
    """
    mid_us = whole(exact_pulses_us(calibration, [calibration.mid_stroke_length_m] * len(STRUT_NAMES)))
    strokes_us = whole(exact_pulses_us(calibration, path.lengths_m)) - mid_us
    strokes_us = strokes_us * np.where(strokes_us[0] < 0, -1, 1)
    return bool((strokes_us >= 0).all() and (strokes_us <= np.minimum.accumulate(strokes_us, axis=0)).all())
