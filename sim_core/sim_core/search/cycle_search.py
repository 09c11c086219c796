# SPDX-License-Identifier: Apache-2.0
"""Finding cycles: a genetic algorithm over pairs of policies that roll on without stopping.

Every generation breeds pairs and has them roll on over the turns of COURSES: on the nominal robot first, and those that get there
on training robots, half of them with ideal actuators and half with actuators that feel their load. Reliability counts first, then
metres for the time that struts are driven, then speed. As in `genetic_search` a generation is a function of its number, the seed and
the elites.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics.actuators import ActuatorParameters, load_actuators
from sim_core.gaits.cycle import TURNS, Cycle, CycleStage, chain_of, faces_of
from sim_core.rolling.course import Course, stages_of_chain
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import checked_policy
from sim_core.structure.symmetry import REFERENCE_TC, REFERENCE_TO
from sim_core.studies.local_runner import Chunk, Draw, Runner, Trials, WhichRobot, joined, run_here
from sim_core.uncertainty.perturbation_law import Law

A, B = TURNS
COURSES = ((A, A, A), (B, B, B), (A, B, B, A, A), (B, B, A, B, A))
"""Turns of the chains on which a pair is tried: straight on both ways, and mixed ones."""
WEIGHTS = np.array([0.35, 0.25, 0.2, 0.2])
"""Of the chains in the merit."""
DWELL_MOST = 10
"""A stage may dwell so many tenths of a second."""
NOMINAL_ENOUGH = 0.95
"""Share of the nominal robot's rolls from which on a pair is tried on training robots."""
FIRST_LOOK = 4
SLACK = 0.12
"""A pair is tried on the rest if its first look is no farther below the last elite."""


@dataclass(frozen=True)
class CyclePlan:
    """What to search.

    Attributes:
        name: of the library.
        seed: same plan and prototype, same library.
        offspring: pairs bred in a generation.
        generations: how many.
        keep: cycles in the library.
        elites: parents of the next generation.
        apart_mm: two of them differ by at least this in some strut.
        scale: of the training robots' errors, and of their actuators'.
        robots: how many of each kind of actuators.
    """

    name: str = "continuous"
    seed: int = 1
    offspring: int = 64
    generations: int = 80
    keep: int = 6
    elites: int = 32
    apart_mm: int = 3
    scale: float = 0.12
    robots: int = 8

    def as_dict(self) -> dict[str, Any]:
        """For a library's provenance."""
        return asdict(self)


class Genes(NamedTuple):
    """A pair of policies, in mm, and how long each stage dwells, in tenths of a second."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    dwell: tuple[int, int]

    @property
    def cycle(self) -> Cycle:
        """As a cycle without name or figures; its stages' own times are not known yet."""
        one, other = (
            CycleStage(checked_policy(policy, 10_000), 0.1 * dwell, 0.0)
            for policy, dwell in zip((self.first, self.second), self.dwell, strict=True)
        )
        return Cycle("", (one, other))


@dataclass(frozen=True)
class Tried:
    """A pair and how good it is."""

    genes: Genes
    merit: float
    margins: Mapping[str, float] = field(default_factory=dict)


class CycleSearch:
    """A search that can be looked at, stopped and resumed between generations."""

    def __init__(self, prototype: Prototype, plan: CyclePlan, runner: Runner = run_here):
        self.prototype, self.plan, self._run = prototype, plan, runner
        self.generation, self.rolled = 0, 0
        self._actuators = load_actuators()
        law = Law(plan.scale)
        self._robots: dict[bool, tuple[WhichRobot, ...]] = {
            feels: tuple(Draw(law, 1000 * plan.seed + 7 + feels, number) for number in range(plan.robots))
            for feels in (False, True)
        }
        self._elites: list[Tried] = []

    @property
    def done(self) -> bool:
        """Nothing left to search."""
        return self.generation >= self.plan.generations

    @property
    def elites(self) -> tuple[Tried, ...]:
        """Best first."""
        return tuple(self._elites)

    def step(self) -> None:
        """One generation."""
        rng = np.random.default_rng([self.plan.seed, self.generation])
        bred = self._bred(rng)
        tried = self._nominal(bred)
        enough = [one for one in tried if one.merit >= NOMINAL_ENOUGH]
        found = [Tried(one.genes, 0.3 * one.merit) for one in tried if one.merit < NOMINAL_ENOUGH]
        first = self._trained([one.genes for one in enough], range(FIRST_LOOK))
        last = self._elites[self.plan.keep - 1].merit if len(self._elites) >= self.plan.keep else 0.0
        worth = [one for one in first if one.merit >= last - SLACK]
        found += [Tried(one.genes, min(one.merit, last) - SLACK) for one in first if one.merit < last - SLACK]
        found += self._trained([one.genes for one in worth], range(self.plan.robots))
        self._keep(found)
        self.generation += 1

    def _keep(self, found: Sequence[Tried]) -> None:
        pool = {one.genes: one for one in (*self._elites, *found)}
        chosen: list[Tried] = []
        for one in sorted(pool.values(), key=lambda t: (-t.merit, t.genes)):
            if len(chosen) == self.plan.elites:
                break
            if all(_apart_mm(one.genes, other.genes) >= self.plan.apart_mm for other in chosen):
                chosen.append(one)
        self._elites = chosen

    def _bred(self, rng: np.random.Generator) -> list[Genes]:
        found: dict[Genes, None] = {}
        limit = self.prototype.policy_limit_mm
        while len(found) < self.plan.offspring:
            found[_offspring(rng, self._elites, limit)] = None
        return list(found)

    def _nominal(self, bred: Sequence[Genes]) -> list[Tried]:
        chains = COURSES[:2]
        work = [(genes.cycle, turns, None) for genes in bred for turns in chains]
        trials = self._rolled(work, None)
        wanted = np.array([2 * (len(turns) + 1) for _, turns, _ in work])
        share = (trials.reached / wanted).reshape(len(bred), -1)
        lack = np.minimum(0.0, trials.clearance_m.reshape(len(bred), -1) - self.prototype.clearance_margin_m).min(axis=1)
        merit = share @ np.array([0.6, 0.4]) + 10.0 * lack
        return [Tried(genes, float(m)) for genes, m in zip(bred, merit, strict=True)]

    def _trained(self, pairs: Sequence[Genes], numbers: range) -> list[Tried]:
        if not pairs:
            return []
        parts = []
        for feels, actuators in ((False, None), (True, self._actuators)):
            robots = [self._robots[feels][number] for number in numbers]
            work = [(genes.cycle, turns, robot) for genes in pairs for turns in COURSES for robot in robots]
            trials = self._rolled(work, actuators)
            shape = len(pairs), len(COURSES), len(robots)
            wanted = np.array([2 * (len(turns) + 1) for turns in COURSES])[None, :, None]
            parts.append(
                (
                    trials.feasible.reshape(shape).mean(axis=2),
                    (trials.reached.reshape(shape) / wanted).mean(axis=2),
                    60.0 * trials.pace_m_s.reshape(shape).mean(axis=2),
                    (trials.driven_s / trials.duration_s).reshape(shape).mean(axis=2),
                )
            )
        feasible, reached, pace, driven = (0.5 * (one + other) for one, other in zip(*parts, strict=True))
        found = []
        for row, genes in enumerate(pairs):
            sure, per_roll = float(WEIGHTS @ feasible[row]), float(WEIGHTS @ reached[row])
            speed = 0.7 * pace[row, 0] + 0.3 * pace[row, 1]
            merit = sure + 0.2 * per_roll + 0.12 * min(speed, 1.8) + 0.03 * speed / max(driven[row, 0], 0.2)
            margins = {
                "chains": round(sure, 4), "rolls": round(per_roll, 4), "m_per_min": round(float(pace[row, 0]), 3),
                "m_per_min_other": round(float(pace[row, 1]), 3), "driven": round(float(driven[row].mean()), 3),
            }  # fmt: skip
            found.append(Tried(genes, 1.0 + merit, margins))
        return found

    def _rolled(self, work: Sequence[tuple[Cycle, tuple[str, ...], WhichRobot]], actuators: ActuatorParameters | None) -> Trials:
        draws = tuple(dict.fromkeys(robot for _, _, robot in work))
        number = {draw: i for i, draw in enumerate(draws)}
        jobs = []
        for cycle, turns, robot in work:
            rolls = chain_of(cycle, faces_of(REFERENCE_TC, REFERENCE_TO, turns))
            jobs.append(Course(number[robot], REFERENCE_TC, stages_of_chain(rolls)))
        self.rolled += len(jobs)
        chunks = [Chunk(self.prototype, draws, tuple(jobs[at : at + 256]), actuators=actuators) for at in range(0, len(jobs), 256)]
        return joined(self._run(chunks))


def _apart_mm(one: Genes, other: Genes) -> int:
    return max(abs(a - b) for a, b in zip(one.first + one.second, other.first + other.second, strict=True))


STEPS_MM = (1.0, 3.0, 8.0)


def _offspring(rng: np.random.Generator, elites: Sequence[Tried], limit: int) -> Genes:
    if len(elites) < 4 or rng.random() < 0.05:
        return Genes(_policy(rng.integers(-limit, limit + 1, 6), limit), _policy(rng.integers(-limit, limit + 1, 6), limit), (0, 0))
    mother = _parent(rng, elites)
    genes = np.array([*mother.first, *mother.second])
    dwell = list(mother.dwell)
    if rng.random() < 0.4:
        father = _parent(rng, elites)
        other = np.array([*father.first, *father.second])
        mixed = rng.random(12) < 0.5 if rng.random() < 0.5 else np.arange(12) < 6
        genes = np.where(mixed, genes, other)
        dwell[1] = father.dwell[1]
    changed = rng.random(12) < (0.15, 0.4)[rng.integers(2)]
    changed[rng.integers(12)] = True
    genes = genes + changed * np.rint(rng.normal(0.0, STEPS_MM[rng.integers(3)], 12)).astype(int)
    if rng.random() < 0.2:
        place = rng.integers(2)
        dwell[place] = int(np.clip(dwell[place] + rng.integers(-2, 3), 0, DWELL_MOST))
    return Genes(_policy(genes[:6], limit), _policy(genes[6:], limit), (dwell[0], dwell[1]))


def _parent(rng: np.random.Generator, elites: Sequence[Tried]) -> Genes:
    return elites[int(rng.integers(len(elites), size=3).min())].genes


def _policy(values: Any, limit: int) -> tuple[int, ...]:
    return tuple(int(value) for value in np.clip(values, -limit, limit))
