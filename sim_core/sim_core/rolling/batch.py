# SPDX-License-Identifier: Apache-2.0
"""Many rolls at once: eight robots in the lanes of the vector unit, blocks of lanes over the cores.

Robots may differ (perturbed prototypes, slopes, first faces, policies). A lane whose roll is over takes the next job, so none
waits for another. A robot's bits do not depend on its lane, its neighbours or the number of threads: each lane computes what
`roll` does.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.actuators import ActuatorParameters
from sim_core.dynamics.footing import center_of_mass
from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import SETTLE_S, SETTLE_ZETA_1_S, Robot
from sim_core.dynamics.simd import ALIGNMENT, WIDTH
from sim_core.errors import ModelError
from sim_core.rolling import quasi_static as q
from sim_core.rolling import roll_monitor as w
from sim_core.rolling.course import Course, CourseResult, course_result_of, table_of
from sim_core.rolling.roll import RollResult, drive_of, face_number, result_of, rules_of, samples_of, stages_of, tolerance_of
from sim_core.rolling.roll_monitor import SAMPLE_S
from sim_core.structure.arrays import Array
from sim_core.structure.elements import PREVIOUS
from sim_core.structure.policy import Policy

FOLLOWING = 1.0
"""Speed of the struts over that of the actuators that they follow. A twin's are twice as fast, and its recorded bits are to stay:
each of its steps of 10 ms is a jerk, which adds up to 30 N to the peaks of strut forces."""


class Job(NamedTuple):
    """One roll: which model (index), from which face, with which policy, onto which face (None: whatever it lands on)."""

    model: int
    source: str
    policy: Policy
    target: str | None = None


class Shared(NamedTuple):
    """What all robots of a batch have in common."""

    dt: float
    zeta: float
    reach: float
    chunk: int
    struts: int
    static: bool
    tolerance: float


class Robots(NamedTuple):
    """What differs from model to model.

    Attributes:
        par: kernel rows, (m, rows).
        body: bodies, (m, rows); (0, rows) if all models have the same.
        mass: masses of the particles, (m, P).
        carry: force above which a joint carries, (m,).
        down: direction of gravity, (m, 3).
        reach, mid, strength: see `roll_monitor.Drive`, (m, 6).
    """

    par: Array
    body: Array
    mass: Array
    carry: Array
    down: Array
    reach: Array
    mid: Array
    strength: Array


def aligned_rows(rows: int) -> Array:
    """Zeros, shape (rows, WIDTH), every row aligned as the lanes need it."""
    raw = np.zeros(rows * WIDTH + ALIGNMENT // 8)
    start = -raw.ctypes.data % ALIGNMENT // 8
    return raw[start : start + rows * WIDTH].reshape(rows, WIDTH)


@njit(nogil=True, cache=True)
def _run(  # noqa: PLR0912 (all that happens to a lane, in one compiled loop)
    state: Array,
    par: Array,
    work: Array,
    track: Array,
    assembly: k.Assembly,
    shared: Shared,
    rules: w.Rules,
    drive: w.Drive,
    robots: Robots,
    starts: Array,
    jobs: NDArray[np.int64],
    stages: Array,
    records: Array,
    peaks: Array,
    centers: Array,
) -> None:
    """Run jobs (model, start, source face, number of stages) one after the other through eight lanes."""
    job_of_lane = np.full(WIDTH, -1)
    running = jobs.shape[0] - jobs.shape[0]  # a variable zero: a literal one would have `_load` compiled twice
    following = running
    for lane in range(WIDTH):
        if following < jobs.shape[0]:
            _load(state, par, work, assembly, lane, following, shared, rules, drive, robots, starts, jobs, stages, records)
            job_of_lane[lane] = following
            following += 1
            running += 1
        else:  # an idle lane repeats the first robot
            for rows in (state, par, work):
                _copy(rows[:, 0], rows[:, lane])
            _copy_body(assembly.body, lane)
    while running > 0:
        if shared.static:
            q.relax(state, par, work, track, assembly, shared.dt, shared.reach, q.LOOK_STEPS)
        else:
            k.advance(state, par, work, assembly, shared.dt, shared.zeta, shared.reach, shared.chunk)
        for lane in range(WIDTH):
            job = job_of_lane[lane]
            if job < 0:
                continue
            model = jobs[job, 0]
            own, driven, course = _own(rules, robots, model), _driven(drive, robots, model), stages[job, : jobs[job, 3]]
            if shared.static:
                q.look(state[:, lane], work[:, lane], track[:, lane], records[job], own, shared.struts, course, shared.tolerance)
            else:
                w.look(state[:, lane], work[:, lane], records[job], own, driven, shared.struts, course)
            if records[job, w.PHASE] == w.GOING:
                continue
            for s in range(6):
                peaks[job, s] = state[shared.struts + s * k.STRUT_ROWS + k.PEAK, lane]
            center_of_mass(state[:, lane], own.mass, centers[job])
            if following < jobs.shape[0]:
                _load(state, par, work, assembly, lane, following, shared, rules, drive, robots, starts, jobs, stages, records)
                for row in range(track.shape[0]):
                    track[row, lane] = 0.0
                job_of_lane[lane] = following
                following += 1
            else:
                job_of_lane[lane] = -1
                running -= 1


@njit(cache=True)
def _copy(source: Array, to: Array) -> None:
    """Copy a column: a slice assignment compiles ten times as long, for its messages about shapes."""
    for row in range(to.shape[0]):
        to[row] = source[row]


@njit(cache=True)
def _own(rules: w.Rules, robots: Robots, model: int) -> w.Rules:
    """The rules with one robot's own numbers."""
    return w.Rules(
        robots.mass[model],
        robots.carry[model],
        robots.down[model],
        rules.rest_speed_m_s,
        rules.hold_samples,
        rules.timeout_samples,
        rules.strut_diameter_m,
        rules.box_radius_m,
        rules.particles,
        rules.face_of_joints,
        rules.face_joints,
        rules.strut_ends,
    )


@njit(cache=True)
def _driven(drive: w.Drive, robots: Robots, model: int) -> w.Drive:
    """The drive with one robot's own numbers."""
    return w.Drive(drive.feels, drive.p, drive.keep, robots.reach[model], robots.mid[model], robots.strength[model])


@njit(cache=True)
def _load(
    state: Array,
    par: Array,
    work: Array,
    assembly: k.Assembly,
    lane: int,
    job: int,
    shared: Shared,
    rules: w.Rules,
    drive: w.Drive,
    robots: Robots,
    starts: Array,
    jobs: NDArray[np.int64],
    stages: Array,
    records: Array,
) -> None:
    """Put a job's robot, settled, into a lane."""
    model, start = jobs[job, 0], jobs[job, 1]
    rows = state.shape[0]
    _copy(starts[start, :rows], state[:, lane])
    _copy(starts[start, rows:], work[:, lane])
    _copy(robots.par[model], par[:, lane])
    _put_body(assembly.body, lane, robots.body, model)
    own = _own(rules, robots, model)
    driven, course = _driven(drive, robots, model), stages[job, : jobs[job, 3]]
    w.begin(state[:, lane], work[:, lane], records[job], own, driven, shared.struts, jobs[job, 2], course)
    if shared.static:
        q.step_lengths(state[:, lane], shared.struts)


@njit(cache=True)
def _put_body(body: Array, lane: int, bodies: Array, model: int) -> None:
    """Put a model's body into a lane, where lanes have their own."""
    if body.ndim == 2:
        _copy(bodies[model], body[:, lane])


@njit(cache=True)
def _copy_body(body: Array, lane: int) -> None:
    """Put the first lane's body into another, where lanes have their own."""
    if body.ndim == 2:
        _copy(body[:, 0], body[:, lane])


@njit(nogil=True, cache=True)
def _settle(state: Array, par: Array, work: Array, assembly: k.Assembly, dt: float, zeta: float, reach: float, steps: int) -> None:
    k.advance(state, par, work, assembly, dt, zeta, reach, steps)


def _par_of(model: Model, actuators: ActuatorParameters | None) -> Array:
    """The kernel's numbers of a robot, whose struts are quick enough to follow these actuators."""
    par, lay, e = model.par.copy(), model.layout, model.elements
    if actuators is not None:
        speed = np.full(6, FOLLOWING * actuators.no_load_speed_m_s)
        par[lay.par_struts : lay.par_struts + 6 * k.STRUT_PAR] = e.strut_gain * speed / e.steps_per_second
    return par


def _family(model: Model) -> tuple[object, ...]:
    """What the models of a batch must have in common."""
    e, assembly = model.elements, model.assembly
    return model.kind, assembly.particles, assembly.isotropic, model.cable_order.tolist(), model.dt_s, e.zeta_1_s, model.prototype


class Batch:
    """Runs rolls of a set of models with the same structure, step and rules.

    Attributes:
        models: what `Job.model` counts.
    """

    def __init__(
        self,
        models: Sequence[Model],
        threads: int | None = None,
        actuators: ActuatorParameters | None = None,
        strength: Array | None = None,
    ):
        """A batch of robots.

        Args:
            models: what `Job.model` counts.
            threads: default all cores.
            actuators: that feel their load; None: the solver's own.
            strength: each actuator's own factor on speed, stall and back-drive force, (m, 6); None: 1.

        Raises:
            ModelError: the models do not fit together.
        """
        if not models:
            raise ModelError("a batch needs at least one model")
        first = models[0]
        for number, model in enumerate(models):
            if _family(model) != _family(first):
                raise ModelError(f"model {number} of the batch differs from model 0 in kind, structure, step, damping or prototype")
        self.models = tuple(models)
        self._threads = threads or os.cpu_count() or 1
        self._rules = rules_of(first)
        each = [rules_of(model) for model in models]
        drives = [drive_of(model, actuators, None if strength is None else strength[number]) for number, model in enumerate(models)]
        self._robots = Robots(
            np.array([_par_of(model, actuators) for model in models]),
            self._bodies(),
            np.array([rules.mass for rules in each]),
            np.array([rules.carry_n for rules in each]),
            np.array([rules.down for rules in each]),
            np.array([drive.reach for drive in drives]),
            np.array([drive.mid for drive in drives]),
            np.array([drive.strength for drive in drives]),
        )
        self._drive = drives[0]
        reach = max(model.reach_m for model in models)
        chunk = samples_of(first, SAMPLE_S)
        self._shared = Shared(
            first.dt_s, first.elements.zeta_1_s, reach, chunk, first.layout.struts, first.kind == PREVIOUS, tolerance_of(first)
        )
        self._starts: dict[tuple[int, str], Array] = {}

    def run(self, jobs: Sequence[Any], report: Callable[[int, int], None] = lambda done, total: None) -> list[Any]:
        """Run every job; results in the jobs' order.

        Args:
            jobs: the rolls.
            report: called with (jobs done, total) now and then.
        """
        self.settle([(job.model, job.source) for job in jobs])
        keys = sorted({(job.model, job.source) for job in jobs})
        place = {key: number for number, key in enumerate(keys)}
        starts = np.array([self._starts[key] for key in keys])
        results: list[RollResult | None] = [None] * len(jobs)
        # robots on the same face have the same joints near the ground: neighbours then do the same work
        order = sorted(range(len(jobs)), key=lambda number: (jobs[number].source, number))
        share = max(WIDTH * 2, min(WIDTH * 32, -(-len(jobs) // self._threads)))
        parts = [order[at : at + share] for at in range(0, len(jobs), share)]
        done = 0
        with ThreadPoolExecutor(self._threads) as pool:
            for part, outcome in zip(
                parts, pool.map(lambda p: self._part([jobs[i] for i in p], place, starts), parts), strict=True
            ):
                for number, result in zip(part, outcome, strict=True):
                    results[number] = result
                done += len(part)
                report(done, len(jobs))
        return [result for result in results if result is not None]

    def _bodies(self) -> Array:
        """Every model's body, (m, rows); (0, rows) if all are the same, which lets the lanes share it."""
        bodies = np.array([model.assembly.body for model in self.models])
        return bodies[:0] if (bodies == bodies[0]).all() else bodies

    def _part(self, jobs: list[Any], place: dict[tuple[int, str], int], starts: Array) -> list[Any]:
        count = len(jobs)
        courses = [self._stages(job) for job in jobs]
        stages = np.zeros((count, max(map(len, courses)), w.STAGE_ROWS))
        for row, course in zip(stages, courses, strict=True):
            row[: len(course)] = course
        table = np.array(
            [
                (job.model, place[job.model, job.source], face_number(job.source), len(course))
                for job, course in zip(jobs, courses, strict=True)
            ]
        )
        records, peaks, centers = np.zeros((count, w.RECORD)), np.zeros((count, 6)), np.zeros((count, 3))
        state, par, work, assembly = self._rows()
        _run(
            state, par, work, aligned_rows(q.TRACK_ROWS), assembly, self._shared, self._rules, self._drive, self._robots,
            starts, table, stages, records, peaks, centers,
        )  # fmt: skip
        return [self._judged(job, *rows) for job, *rows in zip(jobs, records, peaks, centers, strict=True)]

    def _stages(self, job: Job | Course) -> Array:
        model = self.models[job.model]
        return table_of(model, job.stages) if isinstance(job, Course) else stages_of(model, job.policy, job.target)

    def _judged(self, job: Job | Course, record: Array, peaks: Array, center: Array) -> RollResult | CourseResult:
        model = self.models[job.model]
        if isinstance(job, Course):
            return course_result_of(model, job.stages, record, peaks, center)
        return result_of(model, job.source, job.target, job.policy, record, peaks, center)

    def _rows(self) -> tuple[Array, Array, Array, k.Assembly]:
        """Rows for eight lanes, and the assembly, with a body for each lane if the models' differ."""
        first = self.models[0]
        lay, assembly = first.layout, first.assembly
        if len(self._robots.body):
            flat = all(model.assembly.flat for model in self.models)
            assembly = assembly._replace(body=aligned_rows(lay.body_rows), flat=flat)
        return aligned_rows(lay.state_rows), aligned_rows(lay.par_rows), aligned_rows(assembly.particles * k.WORK_ROWS), assembly

    def settle(self, robots: Iterable[tuple[int, str]]) -> None:
        """Settle models on faces, as `Robot.resting_on` does, unless they were before; `run` does so for its jobs."""
        missing = sorted(set(robots) - self._starts.keys())
        groups = [missing[at : at + WIDTH] for at in range(0, len(missing), WIDTH)]
        with ThreadPoolExecutor(self._threads) as pool:
            for group, settled in zip(groups, pool.map(self._settle_group, groups), strict=True):
                self._starts.update(zip(group, settled, strict=True))

    def _settle_group(self, group: list[tuple[int, str]]) -> list[Array]:
        robots = [Robot.placed_on(self.models[model], face) for model, face in group]
        state, par, work, assembly = self._rows()
        for lane in range(WIDTH):
            robot = robots[min(lane, len(robots) - 1)]
            state[:, lane], work[:, lane] = robot.rows()
            par[:, lane] = robot.model.par
            if assembly.body.ndim == 2:
                assembly.body[:, lane] = robot.model.assembly.body
        first, shared = self.models[0], self._shared
        steps = round(SETTLE_S * first.steps_per_second)
        _settle(state, par, work, assembly, shared.dt, SETTLE_ZETA_1_S, shared.reach, steps)
        out = []
        for lane, robot in enumerate(robots):
            robot.take_settled(state[:, lane], work[:, lane])
            out.append(np.concatenate(robot.rows()))
        return out


def roll_many(models: Sequence[Model], jobs: Sequence[Job], threads: int | None = None) -> list[RollResult]:
    """`roll` for many jobs at once; the same results, in the jobs' order."""
    return Batch(models, threads).run(jobs)
