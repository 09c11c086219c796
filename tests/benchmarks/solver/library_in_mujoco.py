# SPDX-License-Identifier: Apache-2.0
"""A library's gaits in MuJoCo: the same robot in another physics engine."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.gaits.library import Library, gait_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.roll_classes import rolls_of
from sim_core.studies.binomial_intervals import Rate, rates_along
from sim_core.studies.ensemble_fit import stood_on_target
from tests.benchmarks.solver.engines import Task
from tests.benchmarks.solver.mujoco_engine import MuJoCo

STEP_S = 2e-3


class Tried(NamedTuple):
    """A library in MuJoCo. `wins`: (primitives, 24)."""

    library: Library
    wins: NDArray[np.bool_]

    @property
    def rates(self) -> list[Rate]:
        """Of each primitive."""
        return rates_along(self.wins)

    @property
    def possible(self) -> tuple[int, int]:
        """For how many rolls some gait works, and how many there are."""
        names = [p.roll_class.name for p in self.library.primitives]
        groups = [self.wins[[name == own for own in names]].any(axis=0) for name in dict.fromkeys(names)]
        return sum(int(group.sum()) for group in groups), sum(group.size for group in groups)


def tried_in_mujoco(prototype: Prototype, library: Library, threads: int) -> Tried:
    """Roll every gait of a library with the nominal robot; a roll succeeds if it stands on the target after actuation and return.

    On level ground only: on a slope MuJoCo's soft contacts creep, and the robot is never at rest.
    """
    gaits = [gait_of(p, source, target) for p in library.primitives for source, target in rolls_of(p.roll_class)]
    results = MuJoCo(prototype, STEP_S).rolls([Task(gait.source, gait.policy) for gait in gaits], threads)
    won = [stood_on_target(result) and result.actuated.face == gait.target for result, gait in zip(results, gaits, strict=True)]
    return Tried(library, np.array(won).reshape(len(library.primitives), 24))


def text_of(tried: Tried) -> str:
    """For people."""
    rates = tried.rates
    counts = [sum(rate.value >= level for rate in rates) for level in (1.0, 0.5)]
    above = sum(rate.value > 0.8 for rate in rates)
    works, pairs = tried.possible
    return (
        f"library {tried.library.name} ({tried.library.hash}) in MuJoCo, nominal robot, level ground:\n"
        f"primitives: {counts[0]} at 100 %, {above} above 80 %, {counts[1]} at or above 50 %, of {len(rates)}\n"
        f"all trials: {100 * tried.wins.mean():.2f} % of {tried.wins.size}; some gait works for {works} of {pairs} rolls"
    )
