# SPDX-License-Identifier: Apache-2.0
"""What an engine must do (judged rolls, for accuracy; crowds that only step, for speed), and our solver doing it."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.simd import ALIGNMENT, WIDTH
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import Policy, lengths_of


class Task(NamedTuple):
    """A policy applied to a robot that rests on a face."""

    source: str
    policy: Policy


class Moment(NamedTuple):
    """A robot some time after its policy was applied."""

    task: Task
    seconds: float


class Crowd(Protocol):
    """Robots at given moments, ready to step."""

    def reset(self) -> None:
        """Put every robot back to its moment."""

    def run(self) -> None:
        """Step every robot for the span that the crowd was made for."""


class Engine(Protocol):
    """One way to simulate the robot."""

    name: str
    step_s: float
    robot_kb: float
    """What a robot needs while it rolls."""
    thread_kb: float
    """What a thread needs besides."""

    def rolls(self, tasks: Sequence[Task], threads: int) -> list[RollResult]:
        """Roll and judge: actuate, wait until at rest; if on another face, return to neutral and wait again."""

    def crowd(self, moments: Sequence[Moment], count: int, span_s: float, threads: int) -> Crowd:
        """`count` robots at the given moments, over and over, that step for `span_s` on so many threads."""


@njit(nogil=True, cache=True)
def _advance_blocks(
    state: Array, par: Array, work: Array, assembly: k.Assembly, dt: float, zeta: float, reach: float, steps: int
) -> None:
    for block in range(state.shape[0]):
        k.advance(state[block], par[block], work[block], assembly, dt, zeta, reach, steps)


class SixStrut:
    """This repository's solver."""

    def __init__(self, prototype: Prototype, steps_per_second: int | None = None):
        """Args: steps_per_second: default the prototype's own."""
        self.model = build_model(replace(prototype, steps_per_second=steps_per_second or prototype.steps_per_second))
        self.name, self.step_s = "sixstrut", self.model.dt_s
        lay, particles = self.model.layout, self.model.assembly.particles
        self.robot_kb, self.thread_kb = 8e-3 * (lay.state_rows + lay.par_rows + particles * k.WORK_ROWS), 0.0
        self._batches: dict[int, Batch] = {}
        self._snapshots: dict[Moment, tuple[Array, Array]] = {}

    def rolls(self, tasks: Sequence[Task], threads: int) -> list[RollResult]:
        """See `Engine`."""
        if threads not in self._batches:
            self._batches[threads] = Batch([self.model], threads)
        return self._batches[threads].run([Job(0, task.source, task.policy) for task in tasks])

    def crowd(self, moments: Sequence[Moment], count: int, span_s: float, threads: int) -> Crowd:
        """See `Engine`."""
        rows = [self._snapshot(moments[i % len(moments)]) for i in range(min(count, len(moments)))]
        steps = round(span_s / self.step_s)
        return _OneOfOurs(self, rows[0], steps) if count == 1 else _ManyOfOurs(self, rows, count, steps, threads)

    def _snapshot(self, moment: Moment) -> tuple[Array, Array]:
        if moment not in self._snapshots:
            robot = Robot.resting_on(self.model, moment.task.source)
            robot.set_targets(lengths_of(self.model.prototype, moment.task.policy))
            robot.advance(round(moment.seconds / self.step_s))
            self._snapshots[moment] = robot.rows()
        return self._snapshots[moment]


class _OneOfOurs:
    """One robot, with the kernel compiled for one: what the twin runs."""

    def __init__(self, engine: SixStrut, rows: tuple[Array, Array], steps: int):
        self._model, self._rows, self._steps = engine.model, rows, steps
        self.reset()

    def reset(self) -> None:
        self._state, self._work = (row.copy() for row in self._rows)

    def run(self) -> None:
        m = self._model
        k.advance(self._state, m.par, self._work, m.assembly, m.dt_s, m.elements.zeta_1_s, m.reach_m, self._steps)


class _ManyOfOurs:
    """Many robots, eight to a vector."""

    def __init__(self, engine: SixStrut, rows: list[tuple[Array, Array]], count: int, steps: int, threads: int):
        self._model, self._steps = engine.model, steps
        who = np.arange(-(-count // WIDTH) * WIDTH).reshape(-1, WIDTH) % len(rows)
        self._first = [np.ascontiguousarray(np.array(column)[who].swapaxes(1, 2)) for column in zip(*rows, strict=True)]
        self._state, self._work = (_aligned(first.shape) for first in self._first)
        self._par = _aligned((len(who), len(engine.model.par), WIDTH))
        self._par[:] = engine.model.par[None, :, None]
        cuts = np.linspace(0, len(who), min(threads, len(who)) + 1).astype(int)
        self._parts = [slice(a, b) for a, b in pairwise(cuts)]
        self.reset()

    def reset(self) -> None:
        self._state[:], self._work[:] = self._first

    def run(self) -> None:
        if len(self._parts) == 1:
            self._advance(self._parts[0])
            return
        with ThreadPoolExecutor(len(self._parts)) as pool:
            list(pool.map(self._advance, self._parts))

    def _advance(self, part: slice) -> None:
        m = self._model
        rows = self._state[part], self._par[part], self._work[part]
        _advance_blocks(*rows, m.assembly, m.dt_s, m.elements.zeta_1_s, m.reach_m, self._steps)


def _aligned(shape: tuple[int, ...]) -> Array:
    """Zeros, every row of WIDTH aligned as the lanes need it."""
    size = int(np.prod(shape))
    raw = np.zeros(size + ALIGNMENT // 8)
    start = -raw.ctypes.data % ALIGNMENT // 8
    return raw[start : start + size].reshape(shape)
