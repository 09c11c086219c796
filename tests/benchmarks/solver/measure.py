# SPDX-License-Identifier: Apache-2.0
"""What is measured: speed, accuracy and memory of the engines, side by side."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.gaits.library import load_library
from sim_core.rolling.roll import RollResult
from sim_core.rolling.roll_monitor import SAMPLE_S
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import checked_policy
from sim_core.structure.topology import FACES, NEIGHBOURS
from sim_core.studies.rehearsal import DEFAULT_MEMBERS, Ensemble
from tests.benchmarks.solver.engines import Engine, Moment, SixStrut, Task
from tests.benchmarks.solver.mujoco_engine import MuJoCo

MUJOCO_STEPS_S = (0.001, 0.002, 0.005)
COUNTS = (1, 8, 64, 512, 4096)
MOMENTS_S = (0.5, 1.5, 2.5, 3.5)
"""The crowds' robots are this long after their policy was applied: driving, tipping, landing."""
FINER = 4
"""An engine's reference has a step this many times shorter."""
SINGLES = 8
"""One robot's speed is measured at so many moments, one after the other."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Plan:
    """How much to measure.

    Attributes:
        threads: numbers of threads. tasks: policies of the accuracy part. seed: of the random ones.
        rounds: measurements of each figure, engines in turn; the fastest counts. budget_s: about how long one takes.
        judged: complete rolls timed. memory_rolls: rolls of the memory part; then four times as many.
    """

    threads: tuple[int, ...] = (1, 2)
    counts: tuple[int, ...] = COUNTS
    tasks: int = 64
    seed: int = 1
    rounds: int = 5
    budget_s: float = 0.25
    judged: int = 512
    memory_rolls: int = 16


@dataclass(frozen=True)
class Speed:
    """One engine's speed with so many robots on so many threads."""

    engine: str
    step_s: float
    robots: int
    threads: int
    us_per_robot_step: float

    @property
    def robot_seconds_per_s(self) -> float:
        """Seconds of robot time, summed over the robots, in a second."""
        return self.step_s / (1e-6 * self.us_per_robot_step)


@dataclass(frozen=True)
class Accuracy:
    """One engine at one step against another run of the same policies.

    Attributes:
        rolled: how many policies end on another face than their first: the others say little about faces.
        same_face: share of policies that end on the same face. median_mm, p90_mm: distance of the centre's end positions.
        settled: share of policies that come to rest within the rule's time.
    """

    engine: str
    step_s: float
    reference: str
    reference_step_s: float
    policies: int
    rolled: int
    same_face: float
    median_mm: float
    p90_mm: float
    settled: float


@dataclass(frozen=True)
class Memory:
    """Of a process that does nothing else.

    Attributes:
        rolls: done first; then four times as many.
        idle_mb: resident size before. once_mb, five_times_mb: largest resident size after the first and after all.
        robot_kb: what a robot needs while it rolls. thread_kb: what a thread needs besides.
    """

    engine: str
    rolls: int
    idle_mb: float
    once_mb: float
    five_times_mb: float
    robot_kb: float
    thread_kb: float


@dataclass(frozen=True)
class Judged:
    """Complete rolls, judged, by the batch solver."""

    rolls: int
    threads: int
    rolls_per_s: float
    robot_seconds_per_s: float


@dataclass(frozen=True)
class Rehearsal:
    """Wall time of rehearsing one gait on an ensemble; median of so many gaits."""

    members: int
    threads: int
    gaits: int
    seconds: float


def tasks_of(prototype: Prototype, count: int, seed: int) -> list[Task]:
    """Half gaits of the library `robust`, over all pairs of faces, half uniformly random policies on random faces."""
    rng, library = np.random.default_rng(seed), load_library("robust")
    pairs = [(source, target) for source, targets in NEIGHBOURS.items() for target in targets]
    tasks = []
    for number in range(count):
        if number % 2 == 0:
            source, target = pairs[rng.integers(len(pairs))]
            gaits = library.gaits(source, target)
            tasks.append(Task(source, gaits[rng.integers(len(gaits))].policy))
        else:
            limit = prototype.policy_limit_mm
            policy = checked_policy(rng.integers(-limit, limit + 1, 6).tolist(), limit)
            tasks.append(Task(list(FACES)[rng.integers(len(FACES))], policy))
    return tasks


def engines_of(prototype: Prototype) -> list[Engine]:
    """Ours at its own step, MuJoCo at each of its steps."""
    return [SixStrut(prototype), *(MuJoCo(prototype, step) for step in MUJOCO_STEPS_S)]


def moments_of(tasks: Sequence[Task], seed: int) -> list[Moment]:
    """64 moments of 16 policies, shuffled: neighbours in a vector are at different moments of different rolls."""
    moments = [Moment(task, seconds) for task in tasks[:16] for seconds in MOMENTS_S]
    order = np.random.default_rng(seed).permutation(len(moments))
    return [moments[i] for i in order]


def speeds(engines: Sequence[Engine], moments: Sequence[Moment], plan: Plan, say: Say) -> list[Speed]:
    """Time every engine with every number of robots and threads, the engines in turn."""
    pace = {engine: _seconds(engine, moments, 8, 0.1, 1) / 0.8 for engine in engines}  # seconds per robot-second
    found = []
    for threads in plan.threads:
        for count in plan.counts:
            if threads > count:
                continue
            say(f"speed: {count} robots, {threads} thread{'s' if threads > 1 else ''}")
            robots = count if count > 1 else SINGLES
            spans = {e: float(np.clip(plan.budget_s / (robots * pace[e]) // SAMPLE_S * SAMPLE_S, SAMPLE_S, 2.0)) for e in engines}
            prepared = {e: _prepared(e, moments, count, spans[e], threads) for e in engines}
            best = dict.fromkeys(engines, np.inf)
            for _ in range(plan.rounds):
                for engine in engines:
                    best[engine] = min(best[engine], prepared[engine]())
            for engine in engines:
                steps = robots * round(spans[engine] / engine.step_s)
                found.append(Speed(engine.name, engine.step_s, count, threads, 1e6 * best[engine] / steps))
    return found


def _seconds(engine: Engine, moments: Sequence[Moment], count: int, span_s: float, threads: int) -> float:
    measure = _prepared(engine, moments, count, span_s, threads)
    return min(measure(), measure())  # the first one compiles


def _prepared(engine: Engine, moments: Sequence[Moment], count: int, span_s: float, threads: int) -> Callable[[], float]:
    """A measurement: puts robots back, then times their steps alone."""
    if count > 1:
        crowds = [engine.crowd(moments, count, span_s, threads)]
    else:
        crowds = [engine.crowd([moment], 1, span_s, 1) for moment in moments[:SINGLES]]

    def measure() -> float:
        total = 0.0
        for crowd in crowds:
            crowd.reset()
            began = time.perf_counter()
            crowd.run()
            total += time.perf_counter() - began
        return total

    return measure


def accuracies(prototype: Prototype, tasks: Sequence[Task], threads: int, say: Say) -> list[Accuracy]:
    """Each engine at each step against its own quarter step, and the two finest runs against each other."""
    rate = prototype.steps_per_second
    pairs: list[tuple[Engine, Engine]] = [(SixStrut(prototype), SixStrut(prototype, FINER * rate))]
    pairs += [(MuJoCo(prototype, step), MuJoCo(prototype, step / FINER)) for step in MUJOCO_STEPS_S]
    found, finest = [], []
    for engine, reference in pairs:
        say(f"accuracy: {engine.name}, {1e3 * engine.step_s:.3g} ms against {1e3 * reference.step_s:.3g} ms, {len(tasks)} policies")
        coarse = engine.rolls(tasks, threads)
        fine = reference.rolls(tasks, threads)
        found.append(compared(engine, coarse, reference, fine))
        finest.append((reference, fine))
    found.append(compared(*finest[0], *finest[1]))
    return found


def judged_rolls(prototype: Prototype, tasks: Sequence[Task], threads: int, say: Say) -> Judged:
    """The batch solver at its whole task: robots roll, are watched and judged, and the next ones take their lanes."""
    say(f"complete rolls: {len(tasks)}")
    engine = SixStrut(prototype)
    engine.rolls(tasks[:64], threads)  # compiled, robots settled on every face
    began = time.perf_counter()
    total = sum(result.duration_s for result in engine.rolls(tasks, threads))
    seconds = time.perf_counter() - began
    return Judged(len(tasks), threads, len(tasks) / seconds, total / seconds)


def rehearsal(prototype: Prototype, threads: int, say: Say) -> Rehearsal:
    """Rehearse the first primitive of each class, and two more of their gaits, one after the other."""
    library = load_library("robust")
    gaits = [
        library.gaits(source, target)[0] for source, target in (("TC6", "TO5"), ("TO5", "TC6"), ("TC6", "TO7"), ("TO5", "TC3"))
    ]
    say(f"rehearsal: {len(gaits)} gaits")
    ensemble = Ensemble(build_model(prototype), threads=threads)
    ensemble.prepare("TC6", "TO5")
    ensemble.rehearse(gaits[:1])  # compiled
    times = []
    for gait in gaits:
        began = time.perf_counter()
        ensemble.rehearse([gait])
        times.append(time.perf_counter() - began)
    return Rehearsal(DEFAULT_MEMBERS, threads, len(gaits), float(np.median(times)))


def compared(engine: Engine, rolls: Sequence[RollResult], reference: Engine, others: Sequence[RollResult]) -> Accuracy:
    """How far two runs of the same policies end from each other."""
    apart = [1e3 * np.hypot(*np.subtract(a.travel_m, b.travel_m)) for a, b in zip(rolls, others, strict=True)]
    return Accuracy(
        engine.name,
        engine.step_s,
        reference.name,
        reference.step_s,
        len(rolls),
        sum(final_face(result) != result.source for result in rolls),
        float(np.mean([final_face(a) == final_face(b) for a, b in zip(rolls, others, strict=True)])),
        float(np.median(apart)),
        float(np.quantile(apart, 0.9)),
        float(np.mean([not result.reason.startswith("not settled") for result in rolls])),
    )


def final_face(result: RollResult) -> str | None:
    """The face it stands on in the end; None if it stands on none."""
    return (result.returned or result.actuated).face


def memories(prototype_file: str | None, plan: Plan, say: Say) -> list[Memory]:
    """Memory of both engines, each in a process of its own."""
    found = []
    for name in ("sixstrut", "MuJoCo"):
        say(f"memory: {name}, {plan.memory_rolls} rolls, then {4 * plan.memory_rolls}")
        settings = {"engine": name, "rolls": plan.memory_rolls, "seed": plan.seed, "prototype": prototype_file}
        command = [
            sys.executable,
            "-m",
            "tests.benchmarks.solver.memory",
            json.dumps(settings | {"threads": plan.threads[-1]}),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
        found.append(Memory(**json.loads(done.stdout)))
    return found
