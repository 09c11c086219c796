# SPDX-License-Identifier: Apache-2.0
"""Finding cycles: a genetic algorithm over pairs of policies that roll on without stopping.

It begins with the pairs of a primitive library's rolls, the second one from where the first leaves off. Every generation breeds
pairs and has them roll on over the turns of COURSES: on the nominal robot first, and those that could become elites on training
robots, half of them with ideal actuators and half with actuators that feel their load. Reliability counts first, then speed and
metres for the time that struts are driven. As in `genetic_search` a generation is a function of its number, the seed, the elites.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics.actuators import ActuatorParameters, load_actuators
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.errors import ParameterError
from sim_core.gaits.cycle import NEXT_TC, SPEED, STRETCH, TURNS, TWIST, Cycle, CycleStage, Switches, chain_of, faces_of
from sim_core.gaits.library import Library, load_library
from sim_core.planning.floor_planner import Floor
from sim_core.rolling.batch import Batch
from sim_core.rolling.course import LATENCY_S, Course, stages_of_chain
from sim_core.search.genetic_search import CHUNK_JOBS, Progress
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import Policy, checked_policy
from sim_core.structure.symmetry import CARRIERS, REFERENCE_TC, REFERENCE_TO
from sim_core.studies.local_runner import Chunk, Draw, Runner, Trials, WhichRobot, joined, run_here
from sim_core.uncertainty.perturbation_law import Law

A, B = TURNS
COURSES = ((A, A, A), (B, B, B), (A, B, B, A, A), (B, B, A, B, A))
"""Turns of the chains on which a pair is tried: straight on both ways, and mixed ones."""
WEIGHTS = np.array([0.35, 0.25, 0.2, 0.2])
"""Of the chains in the merit."""
STRAIGHT = ((A,) * 5, (B,) * 5)
"""Turns of the chains that count a cycle's switches: twelve rolls."""
DWELL_MOST = 10
"""A stage may dwell so many tenths of a second."""
FIRST_LOOK = 2
"""Training robots of each kind on which a pair is tried first."""
DUTY = 0.2
"""Share of the time that a strut may be driven, for the metres in ten minutes."""
OWN_TIME = 0.95
"""Share of training robots that need no longer for a stage than its own time, for where nobody looks."""
TRAINED = 2.0
"""Merit from which on a pair was tried on all training robots."""


@dataclass(frozen=True)
class CyclePlan:
    """What to search.

    Attributes:
        name: of the library.
        start: library whose primitives are the first pairs.
        primitives: library whose primitives go into the new one.
        seed: same plan and prototype, same library.
        offspring: pairs bred in a generation.
        generations: how many.
        keep: cycles in the library.
        elites: parents of the next generation.
        apart_mm: two of them differ by at least this in some strut.
        scale: of the training robots' errors, and of their actuators'.
        robots: how many of each kind of actuators.
        choice: how many more of each for the last choice, and for the switches.
    """

    name: str = "continuous"
    start: str = "robust"
    primitives: str = "staged"
    seed: int = 1
    offspring: int = 64
    generations: int = 20
    keep: int = 2
    elites: int = 24
    apart_mm: int = 6
    scale: float = 0.12
    robots: int = 8
    choice: int = 24

    def __post_init__(self) -> None:
        for name in ("offspring", "generations", "keep", "elites", "apart_mm", "robots", "choice"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} {getattr(self, name)}: valid is a whole number of 1 or more")

    @property
    def seeds(self) -> dict[str, tuple[int, int]]:
        """Of the training robots and of those of the last choice: with ideal actuators, with others."""
        return {use: (at + 10 * self.seed, at + 10 * self.seed + 1) for use, at in (("training", 21_000), ("choice", 22_000))}

    def as_dict(self) -> dict[str, Any]:
        """For a library's provenance."""
        return asdict(self) | {"robot_seeds": {use: list(pair) for use, pair in self.seeds.items()}, "law": Law(self.scale).text}


class Genes(NamedTuple):
    """A pair of policies, in mm, and how long each stage dwells, in tenths of a second."""

    first: Policy
    second: Policy
    dwell: tuple[int, int]

    @property
    def cycle(self) -> Cycle:
        """As a cycle without name or figures; its stages' own times are not known yet."""
        one, other = (
            CycleStage(policy, 0.1 * dwell, 0.0) for policy, dwell in zip((self.first, self.second), self.dwell, strict=True)
        )
        return Cycle("", (one, other))


class Tried(NamedTuple):
    """A pair and how good it is, with figures by name."""

    genes: Genes
    merit: float
    margins: Mapping[str, float]


class CycleSearch:
    """A search that can be looked at, stopped and resumed between generations.

    Attributes:
        plan, prototype: what it searches.
    """

    def __init__(self, prototype: Prototype, plan: CyclePlan, runner: Runner = run_here, state: Mapping[str, Any] | None = None):
        """From the beginning, or from what an earlier one's `state` gave. Raises ParameterError: that belongs to another search."""
        self.prototype, self.plan, self._run = prototype, plan, runner
        self.generation, self.rolled, self.trained = 0, 0, 0
        self._start, self._actuators = load_library(plan.start), load_actuators()
        self._elites: list[Tried] = []
        self._model_hash = build_model(prototype).hash
        self._identity = {"plan": plan.as_dict(), "model_hash": self._model_hash, "start_hash": self._start.hash}
        if state is not None:
            if {key: state.get(key) for key in self._identity} != json.loads(json.dumps(self._identity)):
                raise ParameterError("the search to resume had another plan or model: start a new one, or give the same options")
            self.generation, self.rolled, self.trained = state["generation"], state["rolled"], state["trained"]
            self._elites = [
                Tried(Genes(checked_policy(a, 10_000), checked_policy(b, 10_000), (d[0], d[1])), merit, margins)
                for a, b, d, merit, margins in state["elites"]
            ]

    @property
    def state(self) -> dict[str, Any]:
        """Plain data, for JSON, to go on from."""
        elites = [[*t.genes, t.merit, dict(t.margins)] for t in self._elites]
        return self._identity | {"generation": self.generation, "rolled": self.rolled, "trained": self.trained, "elites": elites}

    @property
    def done(self) -> bool:
        """Nothing left to search."""
        return self.generation >= self.plan.generations

    @property
    def progress(self) -> Progress:
        """How far the search is."""
        found = min(self.plan.keep, sum(t.merit >= TRAINED for t in self._elites))
        best = self._elites[0].merit if self._elites else 0.0
        share = self.generation / self.plan.generations
        return Progress(self.generation, self.rolled, self.trained, {"cycles": found}, {"cycles": best}, self.plan.keep, share)

    @property
    def elites(self) -> tuple[Tried, ...]:
        """Best first."""
        return tuple(self._elites)

    def step(self) -> None:
        """One generation."""
        rng = np.random.default_rng([self.plan.seed, self.generation])
        bred = self._first_pairs() if not self._elites else self._bred(rng)
        tried = self._nominal(bred)
        worth = sorted((one for one in tried if one.merit > max(TRAINED, self._needed)), key=lambda t: (-t.merit, t.genes))
        worth = worth[: self.plan.offspring // 2]  # of the first pairs nearly all would do
        looked = self._trained(worth, "training", range(FIRST_LOOK))
        rest = range(FIRST_LOOK, self.plan.robots)
        best = np.ones((len(COURSES), 2 * len(rest), 2))
        chosen = [
            (one, chains)
            for one, chains in zip(worth, looked, strict=True)
            if _merit(np.concatenate([chains, best], axis=1), one.margins) > self._needed
        ]
        more = self._trained([one for one, _ in chosen], "training", rest)
        whole = {one.genes: np.concatenate([chains, others], axis=1) for (one, chains), others in zip(chosen, more, strict=True)}
        found = []
        for one in tried:
            if one.genes in whole:
                found.append(_figured(one, whole[one.genes]))
            else:
                found.append(one._replace(merit=min(one.merit, 0.9 * TRAINED)))
        self._keep(found)
        self.generation += 1

    def library(self) -> Library:
        """The best cycles, chosen on more robots, with their switches counted, and the plan's primitives. Takes a minute."""
        rolls = load_library(self.plan.primitives)
        ranked = [t for t in self._elites if t.merit >= TRAINED][: 4 * self.plan.keep]
        trials = self._trained(ranked, "choice", range(self.plan.choice))
        again = sorted((_figured(one, found) for one, found in zip(ranked, trials, strict=True)), key=lambda t: (-t.merit, t.genes))
        cycles = tuple(self._measured(f"C{number}", one) for number, one in enumerate(again[: self.plan.keep], start=1))
        provenance = {
            "how": f"genetic search over pairs of policies that roll on, from pairs of library {self._start.name} "
            f"{self._start.hash}; ranked by chains on training prototypes; primitives of library {rolls.name} {rolls.hash}",
            "plan": self.plan.as_dict(),
            "generations": self.generation,
            "nominal_courses": self.rolled,
            "training_courses": self.trained,
            "primitives": dict(rolls.provenance),
        }
        return Library(self.plan.name, self._model_hash, provenance, rolls.primitives, cycles)

    @property
    def _needed(self) -> float:
        """Merit that a pair must promise for more robots than a first look."""
        last = self._elites[self.plan.keep + 1 : self.plan.keep + 2]
        return last[0].merit if last else 0.0

    def _keep(self, found: Sequence[Tried]) -> None:
        pool = {one.genes: one for one in (*found, *self._elites)}
        chosen: list[Tried] = []
        for one in sorted(pool.values(), key=lambda t: (-t.merit, t.genes)):
            if len(chosen) == self.plan.elites:
                break
            if all(_apart_mm(one.genes, other.genes) >= self.plan.apart_mm for other in chosen):
                chosen.append(one)
        self._elites = chosen

    def _first_pairs(self) -> list[Genes]:
        """The start's best rolls onto the TO, each with its best rolls from there on."""
        onward = CARRIERS[NEXT_TC, REFERENCE_TO]
        rolls: dict[bool, list[Policy]] = {True: [], False: []}
        for primitive in self._start.primitives:
            rolls[primitive.roll_class.source == REFERENCE_TC].append(primitive.policy)
        seconds = [checked_policy(onward.relabel(policy), 10_000) for policy in rolls[False][:12]]
        return [Genes(first, second, (0, 0)) for first in rolls[True][:12] for second in seconds]

    def _bred(self, rng: np.random.Generator) -> list[Genes]:
        found: dict[Genes, None] = {}
        while len(found) < self.plan.offspring:
            found[_offspring(rng, self._elites, self.prototype.policy_limit_mm)] = None
        return list(found)

    def _nominal(self, bred: Sequence[Genes]) -> list[Tried]:
        """Tried on the nominal robot; the merit is what it would be if all training robots went through."""
        work = [(genes.cycle, turns, None) for genes in bred for turns in COURSES[:2]]
        trials = self._rolled(work, None)
        self.rolled += len(work)
        shape = len(bred), 2
        share = (trials.reached / np.array([2 * (len(turns) + 1) for _, turns, _ in work])).reshape(shape)
        driven = (trials.driven_s / trials.duration_s).reshape(shape)
        pace, clearance = 60.0 * trials.pace_m_s.reshape(shape), trials.clearance_m.reshape(shape)
        found = []
        for row, genes in enumerate(bred):
            fast = int(np.argmax(pace[row]))
            margins = {SPEED + turn: round(float(pace[row, place]), 3) for place, turn in enumerate(TURNS)} | {
                "m_per_10min": round(float(pace[row, fast]) * 10.0 * min(1.0, DUTY / max(1e-9, float(driven[row, fast]))), 2),
                "clearance_mm": round(1e3 * float(clearance[row].min()), 1),
            }
            if trials.feasible.reshape(shape)[row].all():
                merit = _merit(np.ones((len(COURSES), 1, 2)), margins)
            else:
                merit = float(share[row].mean()) + 10.0 * min(0.0, float(clearance[row].min()) - self.prototype.clearance_margin_m)
            found.append(Tried(genes, merit, margins))
        return found

    def _trained(self, pairs: Sequence[Tried], use: str, numbers: range) -> list[Array]:
        """Each pair's chains: (courses, robots, 2), whether it went well, and share of the rolls made."""
        if not pairs:
            return []
        parts = []
        for seed, actuators in zip(self.plan.seeds[use], (None, self._actuators), strict=True):
            robots = [Draw(Law(self.plan.scale), seed, number) for number in numbers]
            work = [(one.genes.cycle, turns, robot) for one in pairs for turns in COURSES for robot in robots]
            trials = self._rolled(work, actuators)
            self.trained += len(work)
            wanted = np.array([2.0 * (len(turns) + 1) for _, turns, _ in work])
            parts.append(np.stack([trials.feasible, trials.reached / wanted], axis=-1).reshape(len(pairs), len(COURSES), -1, 2))
        return list(np.concatenate(parts, axis=2))

    def _measured(self, name: str, one: Tried) -> Cycle:
        """A cycle with its switches counted, and times that its stages hardly ever exceed where nobody looks."""
        counts = {turn: np.zeros(4, dtype=int) for turn in TURNS}
        first_s, second_s = [], []
        for seed, actuators in zip(self.plan.seeds["choice"], (None, self._actuators), strict=True):
            robots = [Draw(Law(self.plan.scale), seed, number) for number in range(self.plan.choice)]
            for turns in STRAIGHT:
                trials = self._rolled([(one.genes.cycle, turns, robot) for robot in robots], actuators)
                wanted, ends = 2 * (len(turns) + 1), faces_of(REFERENCE_TC, REFERENCE_TO, turns)[-1]
                reached = trials.reached.astype(int)
                left = reached == wanted
                stayed = left & (np.array(trials.toward) == ends)
                counts[turns[0]] += (np.minimum(reached + 1, wanted).sum(), reached.sum(), left.sum(), stayed.sum())
            # from the first landing to the last: the second stage alone; the second, the first, and the second again
            one_s, three_s = (
                self._rolled([(one.genes.cycle, turns, robot) for robot in robots], actuators).between_s for turns in ((), (A,))
            )
            second_s.append(one_s)
            first_s.append(three_s - 2.0 * one_s)
        own_s = [float(np.quantile(np.concatenate(times), OWN_TIME)) for times in (first_s, second_s)]
        speed_mm_s = 1e3 * self.prototype.actuator_speed_m_s
        one_stage, other = (
            # the first roll of a chain comes from neutral
            replace(stage, time_s=round(max(own, max(map(abs, stage.policy)) / speed_mm_s + LATENCY_S), 2))
            for stage, own in zip(one.genes.cycle.stages, own_s, strict=True)
        )
        turns_counted = {turn: Switches(*map(int, rows)) for turn, rows in counts.items()}
        cycle = Cycle(name, (one_stage, other), turns_counted, one.margins)
        return replace(cycle, margins=dict(one.margins) | way_of(self.prototype, cycle))

    def _rolled(self, work: Sequence[tuple[Cycle, tuple[str, ...], WhichRobot]], actuators: ActuatorParameters | None) -> Trials:
        draws = tuple(dict.fromkeys(robot for _, _, robot in work))
        number = {draw: i for i, draw in enumerate(draws)}
        jobs = []
        for cycle, turns, robot in work:
            rolls = chain_of(cycle, faces_of(REFERENCE_TC, REFERENCE_TO, turns))
            jobs.append(Course(number[robot], REFERENCE_TC, stages_of_chain(rolls)))
        parts = [jobs[at : at + CHUNK_JOBS] for at in range(0, len(jobs), CHUNK_JOBS)]
        return joined(self._run([Chunk(self.prototype, draws, tuple(part), actuators=actuators) for part in parts]))


def way_of(prototype: Prototype, cycle: Cycle) -> dict[str, float]:
    """The margins STRETCH and TWIST of a cycle: straight on by either turn, against the footprints at rest."""
    model = build_model(prototype)
    floor, start = Floor(model), Robot.resting_on(model, REFERENCE_TC).joints_m()
    ways = [faces_of(REFERENCE_TC, REFERENCE_TO, turns) for turns in STRAIGHT]
    rolled = Batch([model]).run([Course(0, REFERENCE_TC, stages_of_chain(chain_of(cycle, faces))) for faces in ways])
    told = []
    for faces, found in zip(ways, rolled, strict=True):
        stance = begin = floor.stance(REFERENCE_TC, start)
        for face in faces[1:]:
            stance = floor.rolled(stance, face)
        told.append(complex(*found.travel_m) / complex(stance.x_m - begin.x_m, stance.y_m - begin.y_m))
    return {
        STRETCH: round(float(np.mean(np.abs(told))), 3),
        TWIST: round(float(np.degrees(np.mean(np.angle(told)))), 1),
    }


def _merit(chains: Array, figures: Mapping[str, float]) -> float:
    """Of chains (courses, robots, 2): reliability first, then speed, then metres under duty."""
    sure, rolls = WEIGHTS @ chains.mean(axis=1)
    slow, fast = sorted(figures[SPEED + turn] for turn in TURNS)
    speed = 0.75 * fast + 0.25 * slow
    return TRAINED + float(sure + 0.2 * rolls + 0.25 * speed + 0.12 * figures["m_per_10min"])


def _figured(one: Tried, chains: Array) -> Tried:
    """With the merit and the rates of its trials."""
    sure, rolls = WEIGHTS @ chains.mean(axis=1)
    rates = {"chains": round(float(sure), 4), "rolls": round(float(rolls), 4), "trials": chains.shape[0] * chains.shape[1]}
    return Tried(one.genes, _merit(chains, one.margins), rates | dict(one.margins))


def _apart_mm(one: Genes, other: Genes) -> int:
    return max(abs(a - b) for a, b in zip(one.first + one.second, other.first + other.second, strict=True))


STEPS_MM = (1.0, 3.0, 8.0)


def _offspring(rng: np.random.Generator, elites: Sequence[Tried], limit: int) -> Genes:
    if rng.random() < 0.02:
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
    return elites[int(rng.integers(len(elites), size=2).min())].genes


def _policy(values: Any, limit: int) -> Policy:
    return checked_policy([int(value) for value in np.clip(values, -limit, limit)], limit)
