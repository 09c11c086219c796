# SPDX-License-Identifier: Apache-2.0
"""Rehearsal: a gait on an ensemble of perturbed robots, before the real one moves: will it work, and where may it end?"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sim_core.dynamics.model import Model
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Gait
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.course import Course, stages_of_chain
from sim_core.studies.binomial_intervals import Rate, rate_of
from sim_core.uncertainty.ensemble import Posterior
from sim_core.uncertainty.perturbation_law import Law, sample

DEFAULT_MEMBERS = 24
"""Robots of an ensemble: three vectors of eight."""
DEFAULT_SEED = 80_001
"""Of the default ensemble: neither a training seed nor the held-out one."""
NO_FACE = "no face"


class Rehearsed(NamedTuple):
    """What an ensemble says of a gait, or of a chain of rolls.

    Attributes:
        rate: successes of the members, with their Clopper–Pearson interval.
        outcomes: where the members ended: face (or NO_FACE) -> how many, the most frequent first.
        reasons: why members failed -> how many.
    """

    gait: Gait | Chain
    rate: Rate
    outcomes: Mapping[str, int]
    reasons: Mapping[str, int]


class Ensemble:
    """Perturbed robots that rehearse; settled on a face once, when it is first needed.

    Attributes:
        law: how the members differ: a law, or what was fitted to trials, from which members are drawn by weight.
    """

    def __init__(
        self,
        model: Model,
        law: Law | Posterior | None = None,
        members: int = DEFAULT_MEMBERS,
        seed: int = DEFAULT_SEED,
        threads: int | None = None,
    ):
        """Draw the members; default law: ±10 %. Raises ParameterError, ModelError; EnsembleError: fitted to another model."""
        self.law = Law(0.1) if law is None else law
        self._members = members
        if isinstance(self.law, Posterior):
            models = self.law.models(model, members, seed)
        else:
            models = sample(model, self.law, members, seed)
        self._batch = Batch(models, threads)

    def prepare(self, *faces: str) -> None:
        """Settle the members on these faces now, so that a rehearsal from there need not."""
        self._batch.settle([(member, face) for member in range(self._members) for face in faces])

    def rehearse(self, gaits: Sequence[Gait | Chain]) -> list[Rehearsed]:
        """Every gait and chain on every member, from rest at neutral lengths on its source."""
        jobs = [_job(member, gait) for gait in gaits for member in range(self._members)]
        results = self._batch.run(jobs)
        found = []
        for number, gait in enumerate(gaits):
            own = results[number * self._members : (number + 1) * self._members]
            ends = Counter(result.ended or NO_FACE for result in own)
            why = Counter(result.reason for result in own if not result.feasible)
            rate = rate_of(sum(result.feasible for result in own), self._members)
            found.append(Rehearsed(gait, rate, dict(ends.most_common()), dict(why.most_common())))
        return found


def _job(member: int, gait: Gait | Chain) -> Job | Course:
    if isinstance(gait, Chain):
        return Course(member, gait.source, stages_of_chain(gait.rolls))
    return Job(member, gait.source, gait.policy, gait.target)
