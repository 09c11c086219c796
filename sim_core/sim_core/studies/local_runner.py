# SPDX-License-Identifier: Apache-2.0
"""Independent pieces of work: prototypes by (law, seed, index) and rolls of them, small to send and the same wherever they run.

A runner takes chunks and gives back their trials, in order. `run_here` is the runner of one machine; a cluster's has the same form.
"""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics.actuators import ActuatorParameters
from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import SETTLE_S
from sim_core.errors import ModelError
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.course import Course, CourseResult
from sim_core.rolling.roll import RollResult
from sim_core.structure.arrays import Array
from sim_core.structure.elements import IMPROVED
from sim_core.structure.parameters import Prototype
from sim_core.uncertainty.fit_prior import Member, member_model
from sim_core.uncertainty.perturbation_law import Law, sample_at


class Draw(NamedTuple):
    """One perturbed prototype."""

    law: Law
    seed: int
    number: int


WhichRobot = Draw | Member | None
"""Which robot: a perturbed one, one of a fitted ensemble, or the nominal one."""


@dataclass(frozen=True)
class Chunk:
    """Rolls to be done together.

    Attributes:
        prototype, kind: the nominal robot.
        draws: the robots that `Job.model` counts.
        jobs: what to roll.
        actuators: that feel their load, each off by as much as its robot; None: ideal ones.
    """

    prototype: Prototype
    draws: tuple[WhichRobot, ...]
    jobs: tuple[Job | Course, ...]
    kind: str = IMPROVED
    actuators: ActuatorParameters | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled small: the same rolls come again for each robot, and are sent once."""
        firsts = [job._replace(model=0) for job in self.jobs]
        rolls = {roll: number for number, roll in enumerate(dict.fromkeys(firsts))}
        table = np.array([(job.model, rolls[roll]) for job, roll in zip(self.jobs, firsts, strict=True)], dtype=np.uint32)
        return _unpacked, (self.prototype, self.draws, table.reshape(-1, 2), tuple(rolls), self.kind, self.actuators)


def _unpacked(
    prototype: Prototype,
    draws: tuple[WhichRobot, ...],
    table: NDArray[np.uint32],
    rolls: tuple[Job | Course, ...],
    kind: str,
    actuators: ActuatorParameters | None,
) -> Chunk:
    return Chunk(prototype, draws, tuple(rolls[roll]._replace(model=model) for model, roll in table.tolist()), kind, actuators)


class Cost(NamedTuple):
    """What work took.

    Attributes:
        robot_s: simulated time, settling included.
        core_s: processor time of the process, or wall time × threads if that is less (others work in the same process).
        build_s: wall time in which prototypes were drawn and built, by one thread.
        trials: rolls done.
    """

    robot_s: float = 0.0
    core_s: float = 0.0
    build_s: float = 0.0
    trials: int = 0


class Trials(NamedTuple):
    """Outcomes of a chunk's jobs, in their order; see `RollResult` and `CourseResult` for meanings. Arrays are (jobs,).

    Attributes:
        margin_m: NaN of a course.
        past_edge_m: over the edge that the centre of mass got past the farthest; NaN of a course.
        toward: the wanted face; of a job that wanted none, the adjacent face that it landed on, else the one behind that edge; of a
            course the face at rest at its end.
        landed: it stood on that face after actuation.
        reached: faces of the course; of a roll 1 if it landed.
        pace_m_s, between_s: of a course.
        driven_s: of the strut that is driven the most; of a roll 0.
    """

    feasible: NDArray[np.bool_]
    margin_m: NDArray[np.float32]
    clearance_m: NDArray[np.float32]
    peak_force_n: NDArray[np.float32]
    duration_s: NDArray[np.float32]
    past_edge_m: NDArray[np.float32]
    reached: NDArray[np.float32]
    pace_m_s: NDArray[np.float32]
    between_s: NDArray[np.float32]
    driven_s: NDArray[np.float32]
    toward: tuple[str, ...]
    landed: tuple[bool, ...]
    reason: tuple[str, ...]
    cost: Cost


Reporter = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """Reports nothing."""


def part_of(report: Reporter, before: int, total: int) -> Reporter:
    """Reports a part of the work that begins after `before` of `total`."""
    return lambda done, _: report(before + done, total)


class Runner(Protocol):
    """Runs chunks; trials in the chunks' order, whatever the number of workers. `report` gets (rolls done, rolls in all)."""

    def __call__(self, chunks: Sequence[Chunk], report: Reporter = silent) -> list[Trials]:
        """Run chunks."""


def run_chunk(chunk: Chunk, threads: int = 1, report: Reporter = silent) -> Trials:
    """Build the chunk's prototypes and roll them.

    Raises:
        ParameterError, ModelError: a prototype that cannot be built.
    """
    began, began_cpu = time.perf_counter(), time.process_time()
    batch = _batch_of(chunk.prototype, chunk.kind, chunk.draws, threads, chunk.actuators)
    built = time.perf_counter()
    results = batch.run(chunk.jobs, report)
    core_s = min(time.process_time() - began_cpu, threads * (time.perf_counter() - began))
    starts = len({(job.model, job.source) for job in chunk.jobs})
    robot_s = sum(result.duration_s for result in results) + SETTLE_S * starts
    cost = Cost(robot_s, core_s, built - began, len(results))
    return trials_of(results, cost)


def trials_of(results: Sequence[RollResult | CourseResult], cost: Cost) -> Trials:
    """The outcomes of rolls and courses as arrays."""

    def column(name: str, missing: float = np.nan) -> NDArray[np.float32]:
        return np.array([getattr(result, name, missing) for result in results], dtype=np.float32)

    landed = tuple(_landed(result) for result in results)

    return Trials(
        np.array([result.feasible for result in results], dtype=np.bool_),
        column("margin_m"),
        column("clearance_m"),
        column("peak_force_n"),
        column("duration_s"),
        np.array([_past_edge_m(result) for result in results], dtype=np.float32),
        np.array([getattr(result, "reached", won) for result, won in zip(results, landed, strict=True)], dtype=np.float32),
        column("pace_m_s", 0.0),
        column("between_s", 0.0),
        np.array([np.max(getattr(result, "driven_s", 0.0)) for result in results], dtype=np.float32),
        tuple(_toward(result) for result in results),
        landed,
        tuple(result.reason for result in results),
        cost,
    )


def _landed(result: RollResult | CourseResult) -> bool:
    if isinstance(result, CourseResult):
        return result.reached == result.wanted
    return result.actuated.face == _toward(result)


def _past_edge_m(result: RollResult | CourseResult) -> float:
    return float("nan") if isinstance(result, CourseResult) else max(result.past_edge_m.values())


def _toward(result: RollResult | CourseResult) -> str:
    if isinstance(result, CourseResult):
        return result.ended
    if result.target in result.past_edge_m:
        return result.target
    return max(result.past_edge_m, key=lambda face: result.past_edge_m[face])


@lru_cache(maxsize=4)
def _nominal(prototype: Prototype, kind: str) -> Model:
    return build_model(prototype, kind=kind)


@lru_cache(maxsize=6)
def _batch_of(
    prototype: Prototype, kind: str, draws: tuple[WhichRobot, ...], threads: int, actuators: ActuatorParameters | None
) -> Batch:
    """The robots of a chunk, settled on faces as they were needed: a search comes back to the same ones again and again."""
    strength = None if actuators is None else np.array([_strength_of(draw) for draw in draws])
    return Batch(_models_of(_nominal(prototype, kind), draws), threads, actuators, strength)


def _strength_of(draw: WhichRobot) -> Array:
    """Factors (6,) of a robot's actuators on speed, stall and back-drive force: off by as much as it, from a draw of their own."""
    if not isinstance(draw, Draw):
        return np.ones(6)
    return 1.0 + draw.law.scale * np.random.default_rng([draw.seed, draw.number, 1]).uniform(-1.0, 1.0, 6)


def _models_of(nominal: Model, draws: Sequence[WhichRobot]) -> list[Model]:
    models: dict[int, Model] = {number: nominal for number, draw in enumerate(draws) if draw is None}
    models |= {number: member_model(nominal, draw) for number, draw in enumerate(draws) if isinstance(draw, Member)}
    rows: dict[tuple[Law, int], list[int]] = {}
    for number, draw in enumerate(draws):
        if isinstance(draw, Draw):
            rows.setdefault((draw.law, draw.seed), []).append(number)
    for (law, seed), numbers in rows.items():
        indices = [draw.number for draw in draws if isinstance(draw, Draw) and (draw.law, draw.seed) == (law, seed)]
        try:
            models |= zip(numbers, sample_at(nominal, law, seed, indices), strict=True)
        except ModelError as error:
            raise ModelError(f"a prototype of seed {seed} at ±{100 * law.scale:g} % cannot be built: {error}") from error
    return [models[number] for number in range(len(draws))]


def run_here(chunks: Sequence[Chunk], report: Reporter = silent) -> list[Trials]:
    """The runner of this machine: one chunk after the other, each on all cores."""
    threads, total, before = os.cpu_count() or 1, jobs_in(chunks), 0
    done = []
    for chunk in chunks:
        done.append(run_chunk(chunk, threads, part_of(report, before, total)))
        before += len(chunk.jobs)
    return done


def compile_kernels(prototype: Prototype, kind: str = IMPROVED) -> None:
    """Have everything that a chunk needs compiled, so that its cost is that of work."""
    run_chunk(Chunk(prototype, (None,), (Job(0, "TC1", (0,) * 6),), kind))


def jobs_in(chunks: Iterable[Chunk]) -> int:
    """Number of rolls of all chunks."""
    return sum(len(chunk.jobs) for chunk in chunks)


def joined(parts: Sequence[Trials]) -> Trials:
    """The trials of several chunks as one."""
    *columns, costs = zip(*parts, strict=True)
    whole: list[Any] = [np.concatenate(c) if isinstance(c[0], np.ndarray) else tuple(chain(*c)) for c in columns]
    return Trials._make([*whole, Cost(*map(sum, zip(*costs, strict=True)))])
