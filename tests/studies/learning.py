# SPDX-License-Identifier: Apache-2.0
"""Does learning from trials help? Hidden virtual robots, some trials of each, and what was learnt put to the test.

Run by `./sixstrut fit --demonstrate`.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics.model import Model
from sim_core.gaits.library import Gait, Library, load_library
from sim_core.rolling.batch import Batch, Job
from sim_core.search.genetic_search import Search
from sim_core.search.library_recipes import fitted_to
from sim_core.studies.binomial_intervals import Rate, rate_of
from sim_core.studies.ensemble_fit import Estimate, Fit, Seen, estimates, fit, prior_members, stood_on_target, wins_of
from sim_core.studies.gait_learning import WEIGHT, fitted_prior, gaits_of, roll_of
from sim_core.studies.local_runner import Reporter
from sim_core.studies.rehearsal import DEFAULT_MEMBERS, DEFAULT_SEED
from sim_core.uncertainty.ensemble import Posterior
from sim_core.uncertainty.fit_prior import LABELS, Member, Prior
from sim_core.uncertainty.importance_weights import beta_mean, log_score, predictive
from sim_core.uncertainty.perturbation_law import Law, sample
from tensegrity_lab.studies.fit import FitOptions, half_ranges

TILT_DEG = 1.0
LOW_FRICTION = (0.4, 0.7)
"""Range of the hidden friction factors."""
HIDDEN_STREAM, TRIALS_STREAM = 32, 33
DEFAULT_LAW = Law(0.1)
PREDICTING = 64
"""Members of a fitted ensemble that roll every gait."""


@dataclass(frozen=True)
class Setting(FitOptions):
    """What is demonstrated, and how it is fitted.

    Attributes:
        robots: hidden ones.
        trials: of each.
        primitives: of each class.
        searched: for so many of the robots, those that the shipped library `robust` does worst on, a library is searched on the
            fitted ensemble.
    """

    robots: int = 3
    trials: int = 64
    primitives: int = 4
    searched: int = 1


@dataclass(frozen=True)
class RobotCase:
    """One hidden robot.

    Attributes:
        hidden: what it is.
        found: the fit, which never saw it.
        estimates: what that says, parameter by parameter.
        won: of its trials, how many succeeded.
        steepness: fitted steepness (deg), mean.
        scores: log score of the held-out gaits by the default ensemble, the prior, and the fitted ensemble (nats).
        chosen: rolls, of 48, that succeed when the planner's gait is chosen by the default odds and by the fitted odds; and how
            many have any gait that succeeds.
        libraries: trials that the shipped library `robust` wins on the hidden robot, and those that a library searched on the
            fitted ensemble wins; each of the number of its gaits. None: not searched.
    """

    hidden: Member
    found: Fit
    estimates: tuple[Estimate, ...]
    won: int
    steepness: float
    scores: tuple[float, float, float]
    chosen: tuple[int, int, int]
    libraries: tuple[Rate, Rate] | None


@dataclass(frozen=True)
class Demonstration:
    """All cases. `gaits`: of each robot; `held_out`: of these, not tried before the test."""

    setting: Setting
    library: Library
    gaits: int
    held_out: int
    cases: tuple[RobotCase, ...]


def hidden_robot(prior: Prior, seed: int, number: int) -> Member:
    """A robot on a floor of low friction, tilted by TILT_DEG; its other errors are of the prior's ranges."""
    rng = np.random.default_rng([seed, number, HIDDEN_STREAM])
    base = prior.member(rng.standard_normal(len(LABELS)), seed + 50_000, number)
    downhill = rng.uniform(0.0, 2.0 * math.pi)
    slope = (TILT_DEG * math.cos(downhill), TILT_DEG * math.sin(downhill))
    return base._replace(friction=float(rng.uniform(*LOW_FRICTION)), slope_deg=slope)


def demonstrate(model: Model, library: Library, setting: Setting, bar: Callable[[str], Reporter]) -> Demonstration:
    """Run it. The same setting gives the same figures.

    Args:
        model: the robot's model.
        library: the gait library.
        setting: what is demonstrated.
        bar: title -> a reporter of progress.
    """
    names = dict.fromkeys(p.roll_class.name for p in library.primitives)
    rows = [[p for p in library.primitives if p.roll_class.name == name][: setting.primitives] for name in names]
    gaits = gaits_of([p for row in rows for p in row])
    rolls = [(roll_of(gait), True) for gait in gaits]
    hidden = [hidden_robot(setting.prior, setting.seed, number) for number in range(setting.robots)]
    truth = wins_of(model, hidden, rolls, bar("hidden robots"))
    default = _default_probabilities(model, gaits, setting.lapse, bar("default ensemble"))
    first = wins_of(model, prior_members(setting.prior, setting.members, setting.seed)[1], rolls, bar("prior ensemble"))
    shipped = _won(model, hidden, load_library("robust"), bar("the shipped library"))
    worst = np.argsort(shipped.mean(axis=1), kind="stable")[: setting.searched].tolist()
    cases = []
    for number, robot in enumerate(hidden):
        tried = np.random.default_rng([setting.seed, number, TRIALS_STREAM]).permutation(len(gaits))[: setting.trials]
        case = _case(model, setting, gaits, robot, truth[number], tried, first, default, bar(f"robot {number + 1}"))
        if number in worst:
            found = _searched(model, setting, case, bar(f"library for robot {number + 1}"))
            won = _won(model, [robot], found, bar(f"its gaits on robot {number + 1}"))
            rates = [rate_of(int(wins.sum()), wins.size) for wins in (shipped[number], won)]
            case = replace(case, libraries=(rates[0], rates[1]))
        cases.append(case)
    return Demonstration(setting, library, len(gaits), len(gaits) - setting.trials, tuple(cases))


def _default_probabilities(model: Model, gaits: Sequence[Gait], lapse: float, report: Reporter) -> NDArray[np.float64]:
    members = sample(model, DEFAULT_LAW, DEFAULT_MEMBERS, DEFAULT_SEED)
    jobs = [Job(k, gait.source, gait.policy, gait.target) for k in range(len(members)) for gait in gaits]
    wins = np.array([stood_on_target(result) for result in Batch(members).run(jobs, report)]).reshape(len(members), -1)
    return predictive(wins, np.full(len(members), 1.0 / len(members)), lapse)


def _case(
    model: Model,
    setting: Setting,
    gaits: Sequence[Gait],
    hidden: Member,
    truth: NDArray[np.bool_],
    tried: NDArray[np.int64],
    first: NDArray[np.bool_],
    default: NDArray[np.float64],
    report: Reporter,
) -> RobotCase:
    seen = [Seen(roll_of(gaits[i]), bool(truth[i]), True) for i in tried]
    how = (setting.prior, setting.members, setting.seed, setting.lapse, setting.rounds)
    found = fit(model, seen, *how, report_of=lambda number: report, first_wins=first[:, tried])
    known = fitted_prior(model, found, seen, gaits, PREDICTING, report)
    fitted = np.array([known[roll_of(gait)] for gait in gaits])
    others = np.setdiff1d(np.arange(len(gaits)), tried)
    flat = predictive(first, np.full(len(first), 1.0 / len(first)), setting.lapse)
    scores = tuple(log_score(p[others], truth[others]) for p in (default, flat, fitted))
    for i in tried:
        fitted[i] = beta_mean(float(fitted[i]), WEIGHT, int(truth[i]), 1)
    pairs: dict[tuple[str, str], list[int]] = defaultdict(list)
    for number, gait in enumerate(gaits):
        pairs[gait.source, gait.target].append(number)
    best = [sum(bool(truth[max(own, key=lambda i: p[i])]) for own in pairs.values()) for p in (default, fitted)]
    told = tuple(estimates(found.parameters, found.weights, LABELS, half_ranges(setting.prior)))
    steepness = float(found.weights @ [member.steepness_deg for member in found.members])
    possible = sum(bool(truth[own].any()) for own in pairs.values())
    chosen = best[0], best[1], possible
    return RobotCase(hidden, found, told, int(truth[tried].sum()), steepness, (scores[0], scores[1], scores[2]), chosen, None)


def _searched(model: Model, setting: Setting, case: RobotCase, report: Reporter) -> Library:
    """The library that a search finds on the fitted ensemble."""
    posterior = Posterior(model.hash, {"demonstration": setting.seed}, setting.prior.noise, case.found.members, case.found.weights)
    search = Search(model.prototype, fitted_to(posterior))
    while not search.done:
        search.step()
        report(round(1000 * search.progress.finished), 1000)
    return search.library()


def _won(model: Model, robots: Sequence[Member], library: Library, report: Reporter) -> NDArray[np.bool_]:
    """Which of all the library's gaits each robot wins, (robots, gaits)."""
    return wins_of(model, robots, [(roll_of(gait), True) for gait in gaits_of(library.primitives)], report)
