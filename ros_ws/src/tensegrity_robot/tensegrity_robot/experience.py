"""What a travel's own rolls say of the next ones: of its gaits, and of the way the ground leans.

A mixed logistic regression, fitted anew after every roll (its posterior mode; Breslow and Clayton 1993):

    logit p = logit(odds known before) + a + b_primitive + c_roll + d_gait + lean_kind · u

u is the unit vector, on the floor, of the roll's heading; kind is the source's: on a slope rolls from closed triangles (TC)
fail uphill where rolls from open ones (TO) still work. So one miss uphill makes all such rolls uphill less believed, and one of a
poor gait that gait most, then its primitive's other gaits, then the other gaits of the same roll. The effects are normal about 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.special import expit, logit

from sim_core.elements import Array
from sim_core.floor import LEVEL, Lean
from sim_core.library import Gait

SPREAD_LEAN, SPREAD_ALL, SPREAD_PRIMITIVE, SPREAD_ROLL, SPREAD_GAIT = 4.0, 0.7, 1.0, 0.7, 1.5
"""Standard deviations of the effects, in logits, before any roll."""
MOST_SURE = 0.98
"""Odds before the first roll are not taken for surer than this: they are of other robots, on other ground."""
ITERATIONS = 30
STEP = 4.0
"""Longest Newton step, in logits."""
KINDS = tuple(LEVEL)
Name = tuple[str, ...]


class Experience:
    """Rolls of one travel.

    Attributes:
        leans: by the source's kind, (2,) logits that a heading's unit vector is worth: it points where rolls work better.
    """

    def __init__(self, known: Callable[[Gait], float]):
        """Args: known: odds of a gait before the travel."""
        self._known = known
        self._effects: dict[Name, float] = {}
        self._rolls: list[tuple[Gait, float, bool]] = []
        self.leans: dict[str, Lean] = dict(LEVEL)

    def add(self, gait: Gait, heading_rad: float, success: bool) -> None:
        """A roll was made, or refused."""
        self._rolls.append((gait, heading_rad, success))
        self._fit()

    def of(self, gait: Gait) -> float:
        """Odds of a gait on level ground, by what is known now."""
        return float(expit(_logit(self._known(gait)) + sum(self._effects.get(name, 0.0) for name in _names(gait))))

    def _fit(self) -> None:
        places: dict[Name, int] = {}
        for gait, _, _ in self._rolls:
            for name in _names(gait):
                places.setdefault(name, len(places))
        design = np.zeros((len(self._rolls), 4 + len(places)))
        for row, (gait, heading, _) in zip(design, self._rolls, strict=True):
            first = 2 * KINDS.index(gait.source[:2])
            row[first : first + 2] = math.cos(heading), math.sin(heading)
            row[[4 + places[name] for name in _names(gait)]] = 1.0
        offset = np.array([_logit(self._known(gait)) for gait, _, _ in self._rolls])
        won = np.array([success for _, _, success in self._rolls], dtype=float)
        spread = np.array([*4 * [SPREAD_LEAN], *(_SPREADS[name[0]] for name in places)])
        mode = _mode(design, offset, won, spread)
        self.leans = {kind: (float(mode[2 * k]), float(mode[2 * k + 1])) for k, kind in enumerate(KINDS)}
        self._effects = {name: float(mode[4 + place]) for name, place in places.items()}


_SPREADS = {"all": SPREAD_ALL, "primitive": SPREAD_PRIMITIVE, "roll": SPREAD_ROLL, "gait": SPREAD_GAIT}


def _names(gait: Gait) -> tuple[Name, ...]:
    """The effects that a gait shares with others, and its own."""
    primitive, roll = gait.primitive.name, (gait.source, gait.target)
    return ("all",), ("primitive", primitive), ("roll", *roll), ("gait", primitive, *roll)


def _mode(design: Array, offset: Array, won: Array, spread: Array) -> Array:
    """Posterior mode of the effects by Newton's method; the posterior is log-concave."""
    effects = np.zeros(len(spread))
    for _ in range(ITERATIONS):
        odds = expit(offset + design @ effects)
        slope = design.T @ (won - odds) - effects / spread**2
        bend = (design.T * (odds * (1.0 - odds))) @ design + np.diag(spread**-2.0)
        step = np.linalg.solve(bend, slope)
        step *= min(1.0, STEP / max(1e-12, float(np.abs(step).max())))
        effects += step
        if np.abs(step).max() < 1e-6:
            break
    return effects


def _logit(odds: float) -> float:
    return float(logit(min(MOST_SURE, max(1.0 - MOST_SURE, odds))))
