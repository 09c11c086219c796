# SPDX-License-Identifier: Apache-2.0
"""Fitting robots to outcomes: an ensemble of members, weighted by the trials that they predict.

Every tried gait is rolled on every member by the batch solver. A trial is won if the robot stood on the target after actuation and
after the return, which is what an operator sees; the model's limits of force and clearance play no part in that.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics.model import Model
from sim_core.errors import ModelError, ParameterError
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
from sim_core.structure.arrays import Array
from sim_core.structure.policy import Policy
from sim_core.studies.local_runner import Reporter, part_of, silent
from sim_core.uncertainty import importance_weights as bayes
from sim_core.uncertainty.fit_prior import DIMENSIONS, Member, Prior, headings, member_model

MEMBERS = 128
"""Drawn from the prior."""
ENOUGH = 0.25
"""Another round is drawn while the effective size is below this share of MEMBERS, or of what was asked for instead."""
LEAST = 10.0
"""The lapse rate is softened until the effective size is at least this, or as large as ENOUGH asks: fewer tell little."""
ROUNDS = 2
"""At most so many rounds after the first."""
TOGETHER = 768
"""About how many rolls are done at once: bounds memory, and is independent of the machine."""
PRIOR_STREAM, ROUND_STREAM = 27, 28


class Roll(NamedTuple):
    """A gait that was, or will be, tried: a policy (mm) for one pair of faces."""

    source: str
    target: str
    policy: Policy


class Seen(NamedTuple):
    """One trial of a robot.

    Attributes:
        roll: what was tried.
        won: it stood on the target after actuation and after the return.
        placed: it stood on the floor in the direction in which the model places it; else nobody knows in which.
    """

    roll: Roll
    won: bool
    placed: bool


def stood_on_target(result: RollResult) -> bool:
    """Whether a simulated roll succeeded by what an observer sees."""
    return result.returned is not None and result.actuated.face == result.returned.face == result.target


def wins_of(
    nominal: Model, members: Sequence[Member], rolls: Sequence[tuple[Roll, bool]], report: Reporter = silent
) -> NDArray[np.bool_]:
    """What each member does in each trial, (members, trials).

    `rolls`: what is tried, and whether the robot's direction is known; else each trial of each member has one of its own.

    Raises:
        ModelError: a member that cannot be built.
    """
    fixed = list(dict.fromkeys(roll for roll, placed in rolls if placed))
    loose = [number for number, (_, placed) in enumerate(rolls) if not placed]
    found = np.zeros((len(members), len(rolls)), dtype=np.bool_)
    each = len(fixed) + len(loose)
    share = max(1, TOGETHER // max(1, each))
    for at in range(0, len(members), share):
        own = members[at : at + share]
        models, jobs = [], []
        for member in own:
            models.append(_built(nominal, member))
            jobs += [Job(len(models) - 1, roll.source, roll.policy, roll.target) for roll in fixed]
            for number, angle in zip(loose, headings(member.seed, member.number, len(loose)), strict=True):
                roll = rolls[number][0]
                models.append(_built(nominal, member.turned(float(angle))))
                jobs.append(Job(len(models) - 1, roll.source, roll.policy, roll.target))
        results = Batch(models).run(jobs, part_of(report, at * each, len(members) * each))
        won = np.array([stood_on_target(result) for result in results]).reshape(len(own), each)
        column = {roll: number for number, roll in enumerate(fixed)}
        for number, (roll, placed) in enumerate(rolls):
            found[at : at + share, number] = won[:, column[roll] if placed else len(fixed) + loose.index(number)]
    return found


def _built(nominal: Model, member: Member) -> Model:
    try:
        return member_model(nominal, member)
    except ModelError as error:
        raise ModelError(f"a member of the ensemble cannot be built: {error}; take a narrower prior") from error


@dataclass(frozen=True)
class Fit:
    """An ensemble fitted to trials.

    Attributes:
        members, weights: (members,), of all rounds.
        wins: (members, trials) what each does in the trials seen.
        effective_sizes: after each round.
        lapses: by which the weights were made after each round (`importance_weights.softened`).
        prior, seed, lapse: as asked for.
    """

    members: tuple[Member, ...]
    weights: Array
    wins: NDArray[np.bool_]
    effective_sizes: tuple[float, ...]
    lapses: tuple[float, ...]
    prior: Prior
    seed: int
    lapse: float

    @property
    def effective_size(self) -> float:
        """Of the last round."""
        return self.effective_sizes[-1]

    @property
    def parameters(self) -> Array:
        """(members, DIMENSIONS), in the order of `fit_prior.LABELS`."""
        return np.array([member.parameters for member in self.members])


def prior_members(prior: Prior, count: int, seed: int) -> tuple[Array, tuple[Member, ...]]:
    """Members drawn from the prior: their normal scores (count, DIMENSIONS), and themselves.

    Raises:
        ParameterError: fewer than two members, or a negative seed.
    """
    if count < 2 or seed < 0:
        raise ParameterError(f"{count} members of seed {seed}: valid are two or more, and a seed of 0 or more")
    z = np.random.default_rng([seed, PRIOR_STREAM]).standard_normal((count, DIMENSIONS))
    return z, tuple(prior.member(row, seed, number) for number, row in enumerate(z))


def fit(
    nominal: Model,
    seen: Sequence[Seen],
    prior: Prior | None = None,
    count: int = MEMBERS,
    seed: int = 1,
    lapse: float = bayes.LAPSE,
    rounds: int = ROUNDS,
    report_of: Callable[[int], Reporter] = lambda number: silent,
    first_wins: NDArray[np.bool_] | None = None,
) -> Fit:
    """Fit an ensemble. The same arguments give the same ensemble.

    Args:
        nominal: model of the nominal prototype.
        seen: trials with their outcomes.
        prior: what is thought of the robot before; None: the usual one.
        count: members of each round.
        seed: of all draws.
        lapse: least lapse rate ε.
        rounds: after the first, at most; drawn while too few members carry the weight (ENOUGH).
        report_of: number of a round, from 1 -> what is told (rolls done, rolls in all) of it.
        first_wins: what the prior's members do in these trials, (count, trials), if that is known already.

    Raises:
        ParameterError, ModelError, SimError: impossible members; no trials.
    """
    prior = prior or Prior()
    if not seen:
        raise ParameterError("there is no trial to fit to: give a session with at least one success or failure")
    rolls = [(trial.roll, trial.placed) for trial in seen]
    observed = np.array([trial.won for trial in seen])
    z, members = prior_members(prior, count, seed)
    wins = wins_of(nominal, members, rolls, report_of(1)) if first_wins is None else first_wins
    kernels: list[tuple[bayes.Kernel, int]] = []
    sizes: list[float] = []
    lapses: list[float] = []
    while True:
        base = bayes.log_weights_of(np.zeros(len(z)), z, count, kernels)
        lapses.append(bayes.softened(wins, observed, lapse, base, min(LEAST, ENOUGH * count)))
        weights = bayes.normalised(bayes.log_likelihood(wins, observed, lapses[-1]) + base)
        sizes.append(bayes.effective_size(weights))
        if (lapses[-1] == lapse and sizes[-1] >= ENOUGH * count) or len(kernels) >= rounds:
            return Fit(members, weights, wins, tuple(sizes), tuple(lapses), prior, seed, lapse)
        kernel = bayes.kernel_around(z, weights)
        more = bayes.drawn_from(kernel, count, np.random.default_rng([seed, ROUND_STREAM, len(kernels)]))
        new = tuple(prior.member(row, seed, len(members) + number) for number, row in enumerate(more))
        kernels.append((kernel, count))
        z, members = np.vstack([z, more]), members + new
        wins = np.vstack([wins, wins_of(nominal, new, rolls, report_of(1 + len(kernels)))])


class Estimate(NamedTuple):
    """One parameter: its weighted mean and 90 % interval; `told`: how much narrower the trials made it than the prior (1: not)."""

    label: str
    mean: float
    low: float
    high: float
    told: float


def estimates(parameters: Array, weights: Array, labels: Sequence[str], half_ranges: Sequence[float]) -> list[Estimate]:
    """What weighted members say of each parameter.

    Args:
        parameters: (members, d).
        weights: (members,), sum 1.
        labels: (d,).
        half_ranges: (d,) of the uniform prior.
    """
    found = []
    for column, label, half in zip(parameters.T, labels, half_ranges, strict=True):
        mean = float(weights @ column)
        low, high = bayes.quantiles(column, weights, (0.05, 0.95))
        deviation = math.sqrt(float(weights @ (column - mean) ** 2))
        found.append(Estimate(label, mean, float(low), float(high), deviation / (half / math.sqrt(3.0)) if half else math.nan))
    return found
