# SPDX-License-Identifier: Apache-2.0
"""On which robots a search tries its policies, and with which gaits."""

from typing import Any, NamedTuple

from sim_core.rolling.batch import Job
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy
from sim_core.structure.roll_classes import RollClass, rolls_of
from sim_core.structure.symmetry import carrier
from sim_core.structure.topology import PAIRS
from sim_core.studies.local_runner import Draw, WhichRobot
from sim_core.uncertainty.ensemble import Posterior
from sim_core.uncertainty.perturbation_law import Law


class Try(NamedTuple):
    """A robot to try a policy on, and with which of its class's 24 gaits; None: the reference gait."""

    robot: WhichRobot
    gait: int | None = None

    def job(self, rolls: RollClass, policy: Policy) -> Job:
        """The roll, of a policy for the reference pair; `Job.model` is 0."""
        if self.gait is None:
            return Job(0, rolls.source, policy, rolls.target)
        source, target = rolls_of(rolls)[self.gait]
        return Job(0, source, checked_policy(carrier(source, target).relabel(policy), 10_000, MOST_STAGES), target)


class Training(NamedTuple):
    """Prototypes to train on: the first ones of (law, seed)."""

    law: Law
    prototypes: int
    seed: int

    @property
    def tries(self) -> tuple[Try, ...]:
        """The reference gait on each: their law is symmetric, so it stands for all 24."""
        return tuple(Try(Draw(self.law, self.seed, number)) for number in range(self.prototypes))

    def as_dict(self) -> dict[str, Any]:
        """For a library's provenance."""
        return {"law": self.law.text, "prototypes": self.prototypes, "seed": self.seed}


class FittedTraining(NamedTuple):
    """Robots of a fitted ensemble to train on: `prototypes` of them, drawn by weight with a seed."""

    posterior: Posterior
    prototypes: int
    seed: int

    @property
    def tries(self) -> tuple[Try, ...]:
        """Another of the 24 gaits on each: one robot on one floor has no symmetry, so no gait stands for the others."""
        members = self.posterior.drawn(self.prototypes, self.seed)
        return tuple(Try(member, number % len(PAIRS)) for number, member in enumerate(members))

    def as_dict(self) -> dict[str, Any]:
        """For a library's provenance."""
        return {"law": self.posterior.text, "prototypes": self.prototypes, "seed": self.seed}
