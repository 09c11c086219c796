# SPDX-License-Identifier: Apache-2.0
"""What a travel's own rolls say of the next ones: of its gaits, and of the way the ground leans.

A mixed logistic regression, fitted anew after every roll (its posterior mode; Breslow and Clayton 1993):

    logit p = logit(probability known before) + a + b_primitive + c_roll + d_gait + lean · u / s_primitive

u is the unit vector, on the floor, of the roll's heading, and s how steep the primitive climbs (`sim_core.gaits.climb_limits`): on
a slope, gaits that climb little fail first, and those that climb steeply last. So one miss uphill makes all rolls uphill less
believed, most those by gaits that climb little; and one of a poor gait that gait most, then its primitive's other gaits, then the
other gaits of the same roll. The effects are normal about 0.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.special import expit, logit

from sim_core.gaits.climb_limits import usual_deg
from sim_core.gaits.library import Gait
from sim_core.planning.floor_planner import LEVEL
from sim_core.structure.arrays import Array

SPREAD_ALL, SPREAD_PRIMITIVE, SPREAD_ROLL, SPREAD_GAIT = 0.7, 1.0, 0.7, 1.5
"""Standard deviations of the effects, in logits, before any roll."""
SPREAD_LEAN = 8.0
"""Likewise of each component of the lean, in logits × degrees: 4 logits, from sure to a coin's toss where a gait climbs just so
much, × an incline of 2 degrees."""
LEAST_SURE, MOST_SURE = 0.1, 0.98
"""Probabilities before the first roll are not taken for less or more than this: they are of other robots, on other ground."""
ITERATIONS = 30
STEP = 4.0
"""Longest Newton step, in logits."""
Name = tuple[str, ...]


class Experience:
    """Rolls of one travel.

    Attributes:
        lean: of the ground, as `sim_core.planning.floor_planner` has it: it points where rolls work better.
    """

    def __init__(self, known: Callable[[Gait], float], climbs_deg: Callable[[Gait], float] = usual_deg):
        """Args: known: probability of a gait before the travel. climbs_deg: how steep it climbs."""
        self._known, self._climbs_deg = known, climbs_deg
        self._effects: dict[Name, float] = {}
        self._rolls: list[tuple[Gait, float, bool]] = []
        self.lean = LEVEL

    def add(self, gait: Gait, heading_rad: float, success: bool) -> None:
        """A roll was made, or refused."""
        self._rolls.append((gait, heading_rad, success))
        self._fit()

    def probability(self, gait: Gait) -> float:
        """That a gait works on level ground, by what is known now."""
        return float(expit(_logit(self._known(gait)) + sum(self._effects.get(name, 0.0) for name in _names(gait))))

    def _fit(self) -> None:
        places: dict[Name, int] = {}
        for gait, _, _ in self._rolls:
            for name in _names(gait):
                places.setdefault(name, len(places))
        design = np.zeros((len(self._rolls), 2 + len(places)))
        for row, (gait, heading, _) in zip(design, self._rolls, strict=True):
            row[:2] = np.array((math.cos(heading), math.sin(heading))) / self._climbs_deg(gait)
            row[[2 + places[name] for name in _names(gait)]] = 1.0
        offset = np.array([_logit(self._known(gait)) for gait, _, _ in self._rolls])
        won = np.array([success for _, _, success in self._rolls], dtype=float)
        spread = np.array([SPREAD_LEAN, SPREAD_LEAN, *(_SPREADS[name[0]] for name in places)])
        mode = _mode(design, offset, won, spread)
        self.lean = (float(mode[0]), float(mode[1]))
        self._effects = {name: float(mode[2 + place]) for name, place in places.items()}


_SPREADS = {"all": SPREAD_ALL, "primitive": SPREAD_PRIMITIVE, "roll": SPREAD_ROLL, "gait": SPREAD_GAIT}


def _names(gait: Gait) -> tuple[Name, ...]:
    """The effects that a gait shares with others, and its own."""
    primitive, roll = gait.primitive.name, (gait.source, gait.target)
    return ("all",), ("primitive", primitive), ("roll", *roll), ("gait", primitive, *roll)


def _mode(design: Array, offset: Array, won: Array, spread: Array) -> Array:
    """Posterior mode of the effects by Newton's method; the posterior is log-concave."""
    effects = np.zeros(len(spread))
    for _ in range(ITERATIONS):
        p = expit(offset + design @ effects)
        slope = design.T @ (won - p) - effects / spread**2
        bend = (design.T * (p * (1.0 - p))) @ design + np.diag(spread**-2.0)
        step = np.linalg.solve(bend, slope)
        step *= min(1.0, STEP / max(1e-12, float(np.abs(step).max())))
        effects += step
        if np.abs(step).max() < 1e-6:
            break
    return effects


def _logit(probability: float) -> float:
    return float(logit(min(MOST_SURE, max(LEAST_SURE, probability))))
