# SPDX-License-Identifier: Apache-2.0
"""How long each strut has run lately. The actuators' makers permit 20 % of the time, and not a minute without a pause.

What is counted is what was sent: a strut runs when its pulse changes, and when it is held against more than its back-drive force.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.calibration.whole_pulses import exact_pulses_us, rounded_m, whole
from hardware_bridge.errors import DutyError
from hardware_bridge.safety.limit_checks import MOST_SHAPES, SHAPE_STEP_M, Rules
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.path_extremes import points_along
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

SPELL_S = 1.0
"""Running is counted in spells of so long, which count until so long after they have left a window: never too little."""

_PARTS = 60
"""Parts of the long window; spells that the short one has done with are joined until they fill one."""

_ROUNDING_S = 1e-6


class Spell(NamedTuple):
    """Times that each of the six struts ran, from the first count to the last; in [s] of robot time."""

    start_s: float
    end_s: float
    run_s: tuple[float, ...]

    @property
    def is_known(self) -> bool:
        """Somebody counted it."""
        return math.isfinite(sum(self.run_s))

    def with_next(self, spell: Spell) -> Spell:
        """One spell of two."""
        run_s = tuple(one + other for one, other in zip(self.run_s, spell.run_s, strict=True))
        return Spell(self.start_s, max(self.end_s, spell.end_s), run_s)


@dataclass(frozen=True)
class Duty:
    """Robot time that each strut has run, oldest spell first. Both windows of `Limits` look at it."""

    spells: tuple[Spell, ...] = ()

    def ran(self, run_s: Sequence[float], now_s: float, limits: Limits) -> Duty:
        """With `run_s` (6,) more for the struts, and without what is too old to count."""
        spell = Spell(now_s, now_s, tuple(map(float, run_s)))
        newest = self.spells[-1] if self.spells else None
        if newest is not None and newest.is_known and now_s < newest.start_s + SPELL_S:
            return Duty((*self.spells[:-1], newest.with_next(spell)))
        spells: list[Spell] = []
        for each in self.spells:
            joins = spells and spells[-1].is_known and each.is_known and each.end_s < now_s - limits.burst_window_s - SPELL_S
            if joins and each.end_s - spells[-1].start_s <= limits.duty_window_s / _PARTS:
                spells[-1] = spells[-1].with_next(each)
            elif each.end_s > now_s - limits.longest_window_s - SPELL_S:
                spells.append(each)
        return Duty((*spells, spell))

    def used_s(self, now_s: float, window_s: float) -> NDArray[np.float64]:
        """Time that each strut ran within a window, in [s]. Shape (6,)."""
        used_s: NDArray[np.float64] = self._fading(now_s, window_s)[1][0]
        return used_s

    def is_known(self, now_s: float, limits: Limits) -> bool:
        """Whether anybody knows how long the struts have run lately."""
        return bool(np.isfinite(self.used_s(now_s, limits.longest_window_s)).all())

    def left_s(self, now_s: float, limits: Limits) -> float:
        """How long the strut that has least left may run without a pause from now on, in [s] of robot time."""
        left_s = []
        for window_s, budget_s in limits.duty_windows:
            fades_s, used_s = self._fading(now_s, window_s)
            may_s = np.maximum(0.0, budget_s - used_s)
            ends = np.vstack((may_s[:-1] < fades_s[:, None], np.ones(len(STRUT_NAMES), dtype=bool)))  # before more is forgotten
            left_s.append(may_s[ends.argmax(axis=0), range(len(STRUT_NAMES))].min())
        return float(min(left_s))

    def most_used_s(self, runs_s: NDArray[np.float64], step_s: float, now_s: float, window_s: float) -> NDArray[np.float64]:
        """The most that each strut will ever have run within a window, in [s]. Shape (6,).

        Args:
            runs_s: how long it will run in each step from now on, in [s]; shape (n, 6).
            step_s: how long a step lasts, in [s].
            now_s: robot time.
            window_s: length of the window, in [s].
        """
        fades_s, used_s = self._fading(now_s, window_s)
        steps = np.arange(len(runs_s))
        own_s = np.vstack((np.zeros(len(STRUT_NAMES)), np.cumsum(runs_s, axis=0)))
        gone = np.maximum(0, steps + 1 - math.ceil((window_s + SPELL_S) / step_s))
        before_s = used_s[np.searchsorted(fades_s, steps * step_s, side="right")]
        return np.asarray((before_s + own_s[1:] - own_s[gone]).max(axis=0))

    def wait_s(self, runs_s: NDArray[np.float64], now_s: float, limits: Limits, step_s: float = 1.0) -> float:
        """Rest in [s] after which `runs_s` (6,) or (n, 6), see `most_used_s`, exceeds no window. Infinite: none is enough."""
        windows, runs_s = limits.duty_windows, np.atleast_2d(runs_s)
        rests_s = sorted({0.0, *(fade_s + _ROUNDING_S for window in windows for fade_s in self._fading(now_s, window[0])[0])})

        def fits(rest_s: float) -> bool:
            return all((self.most_used_s(runs_s, step_s, now_s + rest_s, w) <= b + _ROUNDING_S).all() for w, b in windows)

        return rests_s[bisect_left(rests_s, True, key=fits)] if fits(rests_s[-1]) else math.inf

    def _fading(self, now_s: float, window_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """In how long each spell of a window will count no more (n,), and what counts before, between and after (n + 1, 6)."""
        counts = sorted((each for each in self.spells if each.end_s > now_s - window_s - SPELL_S), key=lambda each: each.end_s)
        fades_s = np.array([each.end_s + window_s + SPELL_S - now_s for each in counts])
        runs_s = np.array([each.run_s for each in counts]).reshape(-1, len(STRUT_NAMES))
        return fades_s, np.vstack((np.cumsum(runs_s[::-1], axis=0)[::-1], np.zeros(len(STRUT_NAMES))))


def check_duty(duty: Duty, path: Trajectory, now_s: float, rules: Rules) -> None:
    """Whether both windows have time left for a whole path.

    Raises:
        DutyError: one has not, with strut, time run, limit and how long to wait.
    """
    limits, period_s = rules.limits, rules.pacing.period_s
    runs_s = run_times_s(path, rules)
    for window_s, budget_s in limits.duty_windows:
        most_s = duty.most_used_s(runs_s, period_s, now_s, window_s)
        if (most_s > budget_s + _ROUNDING_S).any():
            worst = int(np.argmax(most_s))
            used_s, needs_s = duty.used_s(now_s, window_s)[worst], runs_s[:, worst].sum()
            wait_s = duty.wait_s(runs_s, now_s, limits, period_s)
            raise DutyError(STRUT_NAMES[worst], float(used_s), float(needs_s), budget_s, window_s, wait_s)


def run_times_s(path: Trajectory, rules: Rules) -> NDArray[np.float64]:
    """Robot time in [s] that the frames of a path will be counted to run, at most, period by period. Shape (n, 6).

    A frame counts as one period for each strut whose pulse it changes. Time is cut into periods, and those in which a strut's
    pulse changes, or which it spends under load, are counted; two more a spell of them, because frames come a little late and
    begin anywhere.
    """
    period_s = rules.pacing.period_s
    count = max(1, math.ceil(path.duration_s / period_s - 1e-9))
    edges = np.linspace(0.0, count * period_s, count + 1)
    times = np.sort(np.concatenate((edges, path.times_s)))
    first = np.searchsorted(times, edges)
    knots_us = exact_pulses_us(rules.calibration, path.lengths_m)
    runs = _loaded(path, edges, rules)
    for strut in range(len(STRUT_NAMES)):
        pulses_us = whole(np.interp(times, path.times_s, knots_us[:, strut]))
        ends = pulses_us[first]
        high = np.maximum(np.maximum.reduceat(pulses_us, first)[:-1], ends[1:])
        low = np.minimum(np.minimum.reduceat(pulses_us, first)[:-1], ends[1:])
        runs[:, strut] |= high != low
    begins = runs & ~np.vstack((np.zeros(len(STRUT_NAMES), dtype=bool), runs[:-1]))
    runs_s: NDArray[np.float64] = period_s * (runs + 2.0 * begins)
    return runs_s


def _loaded(path: Trajectory, edges: NDArray[np.float64], rules: Rules) -> NDArray[np.bool_]:
    """Whether each strut works to hold, between any two edges (n + 1,); a stretch as either of the judged shapes at its ends."""
    points = points_along(path, SHAPE_STEP_M, MOST_SHAPES)
    if points is None:  # such a path is refused for that
        return np.zeros((len(edges) - 1, len(STRUT_NAMES)), dtype=bool)
    at = np.array([rules.loads(tuple(lengths_m)) for lengths_m in rounded_m(rules.calibration, points[1]).tolist()])
    stretches = np.vstack((np.zeros(len(STRUT_NAMES)), np.cumsum(at | np.vstack((at[1:], at[-1:])), axis=0)))
    first = np.maximum(0, np.searchsorted(points[0], edges[:-1], side="right") - 1)
    last = np.maximum(first + 1, np.searchsorted(points[0], edges[1:], side="left"))
    loaded: NDArray[np.bool_] = stretches[last] > stretches[first]
    return loaded


def returns(path: Trajectory, calibration: Calibration) -> bool:
    """Whether a path only takes struts nearer to mid stroke, where they rest: it is never refused for want of duty or supply.

    In whole pulses, as they are sent, and against the least stroke so far: so nothing adds up, neither from knot to knot nor from
    one motion to the next.
    """
    mid_us = whole(exact_pulses_us(calibration, [calibration.mid_stroke_length_m] * len(STRUT_NAMES)))
    strokes_us = whole(exact_pulses_us(calibration, path.lengths_m)) - mid_us
    strokes_us = strokes_us * np.where(strokes_us[0] < 0, -1, 1)
    return bool((strokes_us >= 0).all() and (strokes_us <= np.minimum.accumulate(strokes_us, axis=0)).all())
