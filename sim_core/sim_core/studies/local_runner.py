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

from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import SETTLE_S
from sim_core.errors import ModelError
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
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
    """

    prototype: Prototype
    draws: tuple[WhichRobot, ...]
    jobs: tuple[Job, ...]
    kind: str = IMPROVED

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled small: the same rolls come again for each robot, and are sent once."""
        rolls = {job[1:]: 0 for job in self.jobs}
        rolls = {roll: number for number, roll in enumerate(rolls)}
        table = np.array([(job.model, rolls[job[1:]]) for job in self.jobs], dtype=np.uint32).reshape(-1, 2)
        return _unpacked, (self.prototype, self.draws, table, tuple(rolls), self.kind)


def _unpacked(
    prototype: Prototype, draws: tuple[WhichRobot, ...], table: NDArray[np.uint32], rolls: tuple[Any, ...], kind: str
) -> Chunk:
    return Chunk(prototype, draws, tuple(Job(model, *rolls[roll]) for model, roll in table.tolist()), kind)


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
    """Outcomes of a chunk's jobs, in their order; see `RollResult` for meanings. Arrays are (jobs,).

    Attributes:
        past_edge_m: over the edge that the centre of mass got past the farthest.
        toward: the wanted face; of a job that wanted none, the adjacent face that it landed on, else the one behind that edge.
        landed: it stood on that face after actuation.
    """

    feasible: NDArray[np.bool_]
    margin_m: NDArray[np.float32]
    clearance_m: NDArray[np.float32]
    peak_force_n: NDArray[np.float32]
    duration_s: NDArray[np.float32]
    past_edge_m: NDArray[np.float32]
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
    batch = _batch_of(chunk.prototype, chunk.kind, chunk.draws, threads)
    built = time.perf_counter()
    results = batch.run(chunk.jobs, report)
    core_s = min(time.process_time() - began_cpu, threads * (time.perf_counter() - began))
    starts = len({(job.model, job.source) for job in chunk.jobs})
    robot_s = sum(result.duration_s for result in results) + SETTLE_S * starts
    cost = Cost(robot_s, core_s, built - began, len(results))
    return trials_of(results, cost)


def trials_of(results: Sequence[RollResult], cost: Cost) -> Trials:
    """The outcomes of rolls as arrays."""

    def column(name: str) -> NDArray[np.float32]:
        return np.array([getattr(result, name) for result in results], dtype=np.float32)

    return Trials(
        np.array([result.feasible for result in results], dtype=np.bool_),
        column("margin_m"),
        column("clearance_m"),
        column("peak_force_n"),
        column("duration_s"),
        np.array([max(result.past_edge_m.values()) for result in results], dtype=np.float32),
        tuple(_toward(result) for result in results),
        tuple(result.actuated.face == _toward(result) for result in results),
        tuple(result.reason for result in results),
        cost,
    )


def _toward(result: RollResult) -> str:
    if result.target in result.past_edge_m:
        return result.target
    return max(result.past_edge_m, key=lambda face: result.past_edge_m[face])


@lru_cache(maxsize=4)
def _nominal(prototype: Prototype, kind: str) -> Model:
    return build_model(prototype, kind=kind)


@lru_cache(maxsize=4)
def _batch_of(prototype: Prototype, kind: str, draws: tuple[WhichRobot, ...], threads: int) -> Batch:
    """The robots of a chunk, settled on faces as they were needed: a search comes back to the same ones again and again."""
    return Batch(_models_of(_nominal(prototype, kind), draws), threads)


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
