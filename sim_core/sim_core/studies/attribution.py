# SPDX-License-Identifier: Apache-2.0
"""Which uncertainty kills which gait: failed trials again, with one uncertainty taken away and with one alone.

Errors belong to the prototype's number and member, so taking a group away leaves all others as they were: the failure either
vanishes, and the group was needed for it, or it does not.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.gaits.library import gait_of
from sim_core.rolling.batch import Job
from sim_core.structure.elements import IMPROVED
from sim_core.structure.parameters import Prototype
from sim_core.studies.local_runner import Chunk, Cost, Draw, Reporter, Runner, joined, run_here, silent
from sim_core.studies.robustness import CHUNK_JOBS, Study
from sim_core.uncertainty.perturbation_law import Law

NOMINAL = "none (fails on the nominal robot)"
TOGETHER = "several together"


class Blame(NamedTuple):
    """What one uncertainty does: of `failures` looked at, how many vanish without it, and how many come with it alone."""

    group: str
    failures: int
    vanish_without: int
    come_alone: int


@dataclass(frozen=True)
class Attribution:
    """The failures looked at.

    Attributes:
        failures: (n, 3) primitive, gait and prototype index in the study's arrays.
        failed: how many trials failed in all.
        groups: the law's uncertainties, G.
        vanishes: (n, G) the trial succeeds without the group.
        comes: (n, G) it fails with the group alone.
        nominal: (n,) it fails without any: no uncertainty is to blame.
    """

    failures: NDArray[np.int64]
    failed: int
    groups: tuple[str, ...]
    vanishes: NDArray[np.bool_]
    comes: NDArray[np.bool_]
    nominal: NDArray[np.bool_]
    cost: Cost

    @property
    def blames(self) -> list[Blame]:
        """Of each uncertainty, the most guilty first."""
        rows = [
            Blame(group, len(self.failures), int(self.vanishes[:, g].sum()), int(self.comes[:, g].sum()))
            for g, group in enumerate(self.groups)
        ]
        return sorted(rows, key=lambda row: (-row.vanish_without, -row.come_alone))

    def killers(self) -> list[str]:
        """What killed each failed trial, (n,): the group without which it succeeds.

        Of several, one that also kills alone, then the one that most failures need.
        """
        weight = self.vanishes.sum(axis=0) / (1.0 + len(self.failures))
        names = []
        for vanishes, comes, nominal in zip(self.vanishes, self.comes, self.nominal, strict=True):
            if nominal:
                names.append(NOMINAL)
            elif not vanishes.any():
                names.append(TOGETHER)
            else:
                names.append(self.groups[int(np.argmax(np.where(vanishes, 1.0 + comes + weight, 0.0)))])
        return names

    def killers_by_gait(self, study: Study) -> dict[str, Counter[str]]:
        """Gait name -> how often each uncertainty killed it."""
        found: dict[str, Counter[str]] = {}
        for (p, g, _), killer in zip(self.failures, self.killers(), strict=True):
            source, target = study.gaits[p][g]
            found.setdefault(gait_of(study.primitives[p], source, target).name, Counter())[killer] += 1
        return found


def attribute(
    prototype: Prototype,
    study: Study,
    limit: int,
    runner: Runner = run_here,
    report: Reporter = silent,
) -> Attribution:
    """Try failed trials again, without each of the law's uncertainties and with each alone.

    At most `limit` of all failures, drawn with the study's seed. `report` gets (rolls done, rolls in all).
    """
    failed = np.argwhere(~study.feasible)
    chosen = failed
    if len(failed) > limit:
        rng = np.random.default_rng([study.plan.seed, limit])
        chosen = failed[np.sort(rng.choice(len(failed), limit, replace=False))]
    groups = study.plan.law.groups
    if not len(chosen):
        none = np.zeros((0, len(groups)), dtype=np.bool_)
        return Attribution(chosen, len(failed), groups, none, none, np.zeros(0, dtype=np.bool_), Cost())
    trials = joined(runner(_chunks(prototype, study, chosen), report))
    wins = trials.feasible.reshape(len(chosen), 2 * len(groups) + 1)
    without, alone, nominal = np.split(wins, [len(groups), 2 * len(groups)], axis=1)
    return Attribution(chosen, len(failed), groups, without, ~alone, ~nominal[:, 0], trials.cost)


def _chunks(prototype: Prototype, study: Study, chosen: NDArray[np.int64]) -> list[Chunk]:
    """For each failure: without each group, with each alone, and nominal."""
    law = study.plan.law
    laws = [law.without(group) for group in law.groups] + [law.only(group) for group in law.groups]
    each = max(1, CHUNK_JOBS // (len(laws) + 1))
    return [_chunk(prototype, study, chosen[at : at + each], laws) for at in range(0, len(chosen), each)]


def _chunk(prototype: Prototype, study: Study, rows: NDArray[np.int64], laws: Sequence[Law]) -> Chunk:
    places: dict[Draw | None, int] = {}
    jobs: list[Job] = []
    for p, g, k in rows.tolist():
        source, target = study.gaits[p][g]
        policy = gait_of(study.primitives[p], source, target).policy
        draws = (*(Draw(law, study.plan.seed, study.plan.numbers[k]) for law in laws), None)
        jobs.extend(Job(places.setdefault(draw, len(places)), source, policy, target) for draw in draws)
    return Chunk(prototype, tuple(places), tuple(jobs), IMPROVED)
