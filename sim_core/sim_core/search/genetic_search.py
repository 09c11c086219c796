# SPDX-License-Identifier: Apache-2.0
"""The gait generator: a genetic algorithm around the simulator, for both classes of rolls at once.

Every generation breeds policies for robots resting on the two reference faces and rolls them on the nominal robot, wherever they
go: a feasible roll onto *any* adjacent face is, relabelled by the symmetry group, a primitive of the reference pair. With training
prototypes, feasible ones are then tried on these. The best that differ enough are the elites: the parents of the next generation,
and in the end the library.

Everything a generation does is a function of its number, the seed and the elites, so a search that was stopped goes on as if it
had not been, on any number of workers. (The operators are few, and the libraries that offer them keep their state in pickles:
hence our own.)
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError
from sim_core.gaits.library import Library, Primitive, load_library
from sim_core.rolling.batch import Job
from sim_core.search.archive import Candidate, Elites, distance_mm
from sim_core.search.fitness import FEASIBLE, dropped_merit, merit_of, quality, trained_merit
from sim_core.search.training_robots import FittedTraining, Training, Try
from sim_core.search.variation import offspring
from sim_core.structure.elements import IMPROVED, KINDS, PREVIOUS
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy, in_stages
from sim_core.structure.roll_classes import CLASSES, RollClass
from sim_core.structure.symmetry import carrier
from sim_core.studies.local_runner import Chunk, Runner, Trials, WhichRobot, joined, run_here

CHUNK_JOBS = 256
"""About how many rolls make a chunk: independent of the workers."""
RELIABLE, POLISH_RELIABLE = 0.95, 8
FIRST_LOOK = 4
"""Training prototypes of each law on which a policy is tried first."""
LEAST_RATE, SLACK = 0.5, 0.15
"""It goes on if at least LEAST_RATE of these trials succeed, and no fewer than SLACK below the success rate that it needs to be
among those of which the library is chosen."""


@dataclass(frozen=True)
class SearchPlan:
    """What to search.

    Attributes:
        name: of the library.
        kind: model.
        classes: names of the classes of rolls.
        keep: primitives to keep per class.
        seed: same plan and prototype, same library.
        offspring: per class and generation.
        generations: at most.
        evaluations: nominal rolls, at most.
        polish: generations after a class has enough feasible elites. A class with enough that hardly ever fail in training
            (RELIABLE), which can become little but gentler, gets POLISH_RELIABLE of them.
        active: struts that a policy may move.
        apart_mm: two primitives differ by at least this in some strut.
        training: prototypes on which feasible policies are tried; none: the nominal robot alone decides.
        choice: more of them, for the last choice among `spare` × keep elites per class.
        stages: of a policy.
        start: library whose policies are the first, each stage alike; of classes that are not searched its primitives are kept.
    """

    name: str = "mine"
    kind: str = IMPROVED
    classes: tuple[str, ...] = tuple(CLASSES)
    keep: int = 20
    seed: int = 1
    offspring: int = 128
    generations: int = 400
    polish: int = 6
    evaluations: int = 200_000
    active: int = 6
    apart_mm: int = 15
    training: tuple[Training | FittedTraining, ...] = ()
    choice: tuple[Training | FittedTraining, ...] = ()
    spare: int = 2
    stages: int = 1
    start: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ParameterError(f"unknown model {self.kind!r}: valid are {', '.join(KINDS)}")
        if not 1 <= self.stages <= MOST_STAGES or (self.stages > 1 and (self.kind == PREVIOUS or self.active < 6)):
            raise ParameterError(f"{self.stages} stages: valid is 1 to {MOST_STAGES}; 1 for the model previous or few struts")
        if not 1 <= self.active <= 6:
            raise ParameterError(f"{self.active} active struts: valid is 1 to 6")
        unknown = [name for name in self.classes if name not in CLASSES]
        if unknown or not self.classes:
            raise ParameterError(f"class {', '.join(unknown) or 'missing'}: valid are {', '.join(CLASSES)}")
        for name in ("keep", "offspring", "generations", "evaluations", "apart_mm", "spare"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} {getattr(self, name)}: valid is a whole number of 1 or more")

    def as_dict(self) -> dict[str, Any]:
        """The plan, for a library's provenance."""
        plain = asdict(replace(self, training=(), choice=()))
        plain |= {key: [training.as_dict() for training in getattr(self, key)] for key in ("training", "choice")}
        return plain | {"classes": list(self.classes)}


class Progress(NamedTuple):
    """Where a search is.

    Attributes:
        generation: done so far.
        rolled: nominal rolls so far.
        trained: trials on training prototypes so far.
        found: feasible elites per class.
        best: best merit per class.
        wanted: elites that a class wants.
        finished: share of the work that is surely done, in [0, 1].
    """

    generation: int
    rolled: int
    trained: int
    found: Mapping[str, int]
    best: Mapping[str, float]
    wanted: int
    finished: float


class Search:
    """A search that can be looked at, stopped and resumed between generations.

    Attributes:
        plan, prototype: what it searches.
    """

    def __init__(self, prototype: Prototype, plan: SearchPlan, runner: Runner = run_here, state: Mapping[str, Any] | None = None):
        """From the beginning, or from what an earlier one's `state` gave. Raises ParameterError: that belongs to another search."""
        self.prototype, self.plan, self._run = prototype, plan, runner
        self._identity = {"plan": json.loads(json.dumps(plan.as_dict())), "model_hash": build_model(prototype, kind=plan.kind).hash}
        self._classes = {name: CLASSES[name] for name in plan.classes}
        most = plan.keep * (plan.spare + 1)
        self.generation, self.rolled, self.trained = 0, 0, 0
        self._elites = {name: Elites(plan.apart_mm, most) for name in self._classes}
        self._enough_since: dict[str, int] = {}
        self._reliable_since: dict[str, int] = {}
        if state is not None:
            if {key: state.get(key) for key in self._identity} != self._identity:
                raise ParameterError("the search to resume had another plan or model: start a new one, or give the same options")
            self.generation, self.rolled, self.trained = state["generation"], state["rolled"], state["trained"]
            self._enough_since, self._reliable_since = dict(state["enough_since"]), dict(state["reliable_since"])
            for name, rows in state["elites"].items():
                self._elites[name].add(Candidate(checked_policy(p, 10_000, MOST_STAGES), m, margins) for p, m, margins in rows)

    @property
    def state(self) -> dict[str, Any]:
        """Plain data, for JSON, to go on from."""
        elites = {name: [[list(c.policy), c.merit, dict(c.margins)] for c in e.ranked] for name, e in self._elites.items()}
        return self._identity | {
            "generation": self.generation,
            "rolled": self.rolled,
            "trained": self.trained,
            "enough_since": self._enough_since,
            "reliable_since": self._reliable_since,
            "elites": elites,
        }

    @property
    def open_classes(self) -> tuple[str, ...]:
        """Classes that are still searched: too few feasible elites, or not yet polished."""
        return tuple(name for name in self._classes if self._polished(name) < 1.0)

    def _polished(self, name: str) -> float:
        """Share of a class's polish that is done, in [0, 1]."""
        shares = [
            (self.generation - since[name]) / max(1, generations)
            for since, generations in ((self._enough_since, self.plan.polish), (self._reliable_since, POLISH_RELIABLE))
            if name in since
        ]
        return min(1.0, max(shares, default=0.0))

    @property
    def done(self) -> bool:
        """Nothing left to search."""
        p = self.plan
        return not self.open_classes or self.generation >= p.generations or self.rolled >= p.evaluations

    @property
    def progress(self) -> Progress:
        """How far the search is."""
        found = {name: min(elites.count(FEASIBLE), self.plan.keep) for name, elites in self._elites.items()}
        best = {name: max((c.merit for c in elites.ranked[:1]), default=0.0) for name, elites in self._elites.items()}
        share = sum(0.1 * found[name] / self.plan.keep + 0.9 * self._polished(name) for name in found) / len(found)
        return Progress(self.generation, self.rolled, self.trained, found, best, self.plan.keep, 1.0 if self.done else share)

    def step(self) -> None:
        """One generation of every open class."""
        names = self.open_classes
        bred = [(self._classes[name], policy) for name in names for policy in self._bred(name)]
        trials = self._rolled([(Job(0, rolls.source, policy), None) for rolls, policy in bred])
        self.rolled += len(bred)
        candidates: dict[str, list[Candidate]] = {name: [] for name in names}
        feasible = []
        for row, (rolls, policy) in enumerate(bred):
            own = _for_reference(policy, rolls.source, trials.toward[row])
            candidate = Candidate(own, merit_of(self.prototype, own, trials, row), _margins(trials, row))
            if trials.feasible[row] and self.plan.training:
                feasible.append((rolls, candidate, quality(self.prototype, own, trials, row)))
            else:
                candidates[rolls.name].append(candidate)
        for rolls, candidate in self._trained(feasible):
            candidates[rolls.name].append(candidate)
        self.generation += 1
        for name in names:
            self._elites[name].add(candidates[name])
            for since, merit in ((self._enough_since, FEASIBLE), (self._reliable_since, trained_merit(RELIABLE, 0.0))):
                if name not in since and self._elites[name].count(merit) >= self.plan.keep:
                    since[name] = self.generation

    def library(self) -> Library:
        """The best feasible elites, `keep` of each class; chosen by more trials if the plan says so."""
        primitives: list[Primitive] = []
        for name, rolls in self._classes.items():
            ranked = [c for c in self._elites[name].ranked if c.merit >= FEASIBLE]
            if self.plan.choice:
                ranked = self._chosen(rolls, ranked[: self.plan.keep * self.plan.spare])
            primitives += [Primitive("", rolls, c.policy, c.margins) for c in ranked[: self.plan.keep]]
        if self.plan.start:
            primitives += [p for p in load_library(self.plan.start).primitives if p.roll_class.name not in self._classes]
        named = tuple(replace(p, name=f"P{number}") for number, p in enumerate(primitives, start=1))
        provenance = {
            "how": "genetic search over whole-mm policies; feasible on the nominal model"
            + (", ranked by success on training prototypes" if self.plan.training else ", ranked by margins, gentleness and time"),
            "plan": self.plan.as_dict(),
            "generations": self.generation,
            "nominal_rolls": self.rolled,
            "training_trials": self.trained,
        }
        return Library(self.plan.name, self._identity["model_hash"], provenance, named)

    def _bred(self, name: str) -> list[Policy]:
        rng = np.random.default_rng([self.plan.seed, list(CLASSES).index(name), self.generation])
        elites, limit = self._elites[name].ranked, self.prototype.policy_limit_mm
        if self.plan.start and not self.generation:
            return [p.policy * self.plan.stages for p in load_library(self.plan.start).primitives if p.roll_class.name == name]
        found: dict[Policy, None] = {}
        while len(found) < self.plan.offspring:
            found[offspring(rng, elites, limit, self.plan.active, self.plan.stages)] = None
        return list(found)

    def _rolled(self, work: Sequence[tuple[Job, WhichRobot]]) -> Trials:
        """Trials of jobs, each on its own robot, in the work's order; jobs' model numbers are set here."""
        draws = tuple(dict.fromkeys(draw for _, draw in work))
        number = {draw: i for i, draw in enumerate(draws)}
        chunks = []
        for at in range(0, len(work), CHUNK_JOBS):
            jobs = tuple(job._replace(model=number[draw]) for job, draw in work[at : at + CHUNK_JOBS])
            chunks.append(Chunk(self.prototype, draws, jobs, self.plan.kind))
        return joined(self._run(chunks))

    def _trained(self, feasible: Sequence[tuple[RollClass, Candidate, float]]) -> list[tuple[RollClass, Candidate]]:
        """Feasible candidates with the merit of their success rate.

        A first look at all that could become elites, the rest for those that still could and won half of it.
        """
        feasible = [item for item in feasible if self._could_enter(item[0], item[1].policy, trained_merit(1.0, item[2]))]
        if not feasible:
            return []
        first = tuple(one for t in self.plan.training for one in t.tries[:FIRST_LOOK])
        rest = tuple(one for t in self.plan.training for one in t.tries[FIRST_LOOK:])
        wins = self._wins([(rolls, c.policy) for rolls, c, _ in feasible], first)
        best = [(won + len(rest)) / (len(first) + len(rest)) for won in wins]
        least = {name: max(LEAST_RATE, self._needed_rate(name) - SLACK) for name in self._classes}
        worth = [
            i
            for i, (rolls, candidate, own_quality) in enumerate(feasible)
            if wins[i] >= least[rolls.name] * len(first)
            and self._could_enter(rolls, candidate.policy, trained_merit(best[i], own_quality))
        ]
        more = dict(zip(worth, self._wins([(feasible[i][0], feasible[i][1].policy) for i in worth], rest), strict=True))
        found = []
        for i, (rolls, candidate, own_quality) in enumerate(feasible):
            if i in more:
                trials = len(first) + len(rest)
                rate = (wins[i] + more[i]) / trials
                merit = trained_merit(rate, own_quality)
            else:
                trials, rate = len(first), wins[i] / len(first)
                merit = dropped_merit(rate)
            found.append((rolls, candidate._replace(merit=merit, margins=_tried(candidate.margins, rate, trials))))
        return found

    def _could_enter(self, rolls: RollClass, policy: Policy, merit: float) -> bool:
        """No elite near this policy has more than this merit."""
        near = (c for c in self._elites[rolls.name].ranked if distance_mm(c.policy, policy) < self.plan.apart_mm)
        return all(c.merit < merit for c in near)

    def _needed_rate(self, name: str) -> float:
        """Success rate of the last elite that the library may be chosen from; 0 if there are fewer."""
        last = self._elites[name].ranked[self.plan.keep * self.plan.spare - 1 :][:1]
        return last[0].margins.get("success", 0.0) if last and last[0].merit >= FEASIBLE else 0.0

    def _wins(self, policies: Sequence[tuple[RollClass, Policy]], tries: Sequence[Try]) -> list[int]:
        """Successes of each policy in these tries."""
        if not policies or not tries:
            return [0] * len(policies)
        work = [(one.job(rolls, policy), one.robot) for rolls, policy in policies for one in tries]
        self.trained += len(work)
        return [int(won) for won in self._rolled(work).feasible.reshape(len(policies), len(tries)).sum(axis=1)]

    def _chosen(self, rolls: RollClass, ranked: Sequence[Candidate]) -> list[Candidate]:
        """Candidates ranked by their success on the prototypes of the last choice."""
        tries = tuple(one for t in self.plan.choice for one in t.tries)
        wins = self._wins([(rolls, c.policy) for c in ranked], tries)
        tried = [c._replace(margins=_tried(c.margins, won / len(tries), len(tries))) for c, won in zip(ranked, wins, strict=True)]
        return sorted(tried, key=lambda c: (-c.margins["success"], -c.merit, c.policy))


def search(
    prototype: Prototype,
    plan: SearchPlan,
    runner: Runner = run_here,
    report: Callable[[Search], None] = lambda _: None,
    state: Mapping[str, Any] | None = None,
) -> Library:
    """Search from the beginning, or from an earlier search's state, to the end; `report` gets the search after every generation.

    Raises:
        ParameterError: a state of another search.
    """
    running = Search(prototype, plan, runner, state)
    while not running.done:
        running.step()
        report(running)
    return running.library()


def _margins(trials: Trials, row: int) -> dict[str, float]:
    return {
        "inside_mm": round(1e3 * float(trials.margin_m[row]), 2),
        "clearance_mm": round(1e3 * float(trials.clearance_m[row]), 2),
        "peak_force_n": round(float(trials.peak_force_n[row]), 1),
        "duration_s": round(float(trials.duration_s[row]), 2),
    }


def _tried(margins: Mapping[str, float], rate: float, trials: int) -> dict[str, float]:
    return {"success": round(rate, 4), "trials": trials} | {k: v for k, v in margins.items() if k not in ("success", "trials")}


def _for_reference(policy: Policy, source: str, target: str) -> Policy:
    """The policy of the reference pair whose relabelling to (source, target) is `policy`."""
    struts = carrier(source, target).struts
    return tuple(part[struts[s]] for part in in_stages(policy) for s in range(6))
