# SPDX-License-Identifier: Apache-2.0
"""MuJoCo as an engine of the benchmark: one robot by `mj_step`, batches by its own `rollout`, a pool of threads in C++."""

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.footing import center_of_mass
from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import SETTLE_S, SETTLE_ZETA_1_S, Robot
from sim_core.rolling import roll_monitor as w
from sim_core.rolling.batch import Job
from sim_core.rolling.course import Course, CourseResult, course_result_of, table_of
from sim_core.rolling.roll import RollResult, drive_of, face_number, result_of, rules_of, stages_of
from sim_core.rolling.roll_monitor import SAMPLE_S
from sim_core.structure import mujoco_model
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import Policy, lengths_of, neutral_lengths
from sim_core.structure.topology import JOINTS
from tests.benchmarks.solver.engines import Crowd, Moment, Task


class MuJoCo:
    """MuJoCo, on the robot of `mujoco_model`."""

    def __init__(self, robot: Prototype | Model, step_s: float, integrator: str = "implicitfast"):
        """Args: robot: the nominal one of a prototype, or any."""
        self._mujoco = importlib.import_module("mujoco")
        self._rollout = importlib.import_module("mujoco.rollout")
        self.name, self.step_s = "MuJoCo", step_s
        self.ours = robot if isinstance(robot, Model) else build_model(robot)
        self.plain, self.watched = (
            mujoco_model.compiled(self.ours.elements, step_s, integrator, sensors) for sensors in (False, True)
        )
        self._kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        data = self._mujoco.MjData(self.plain)
        self.robot_kb = 8e-3 * self._mujoco.mj_stateSize(self.plain, self._kind)
        self.thread_kb = 1e-3 * (data.nbuffer + data.narena)
        self._rests: dict[str, Array] = {}
        self._snapshots: dict[Moment, Array] = {}

    def rolls(self, tasks: Sequence[Task], threads: int) -> list[RollResult]:
        """As `SixStrut.rolls`, judged by the very same compiled code; strut forces are not watched."""
        return judged([self], [Job(0, task.source, task.policy) for task in tasks], threads)

    def crowd(self, moments: Sequence[Moment], count: int, span_s: float, threads: int) -> Crowd:
        """See `Engine`."""
        chosen = [moments[i % len(moments)] for i in range(count)]
        states = np.array([self._snapshot(moment) for moment in chosen])
        controls = np.array([self.controls(moment, span_s) for moment in chosen])
        return _OneOfTheirs(self, states[0], controls[0]) if count == 1 else _ManyOfTheirs(self, states, controls, threads)

    def resting(self, source: str) -> Array:
        """State (FULLPHYSICS) of a robot settled on a face, as `Robot.resting_on` settles ours."""
        if source not in self._rests:
            robot = Robot.placed_on(self.ours, source)
            state, _ = robot.rows()
            particles = state[: self.ours.layout.struts].reshape(-1, k.PARTICLE_ROWS)
            data = self._mujoco.MjData(self.plain)
            quaternions = particles[:, k.Q : k.Q + 4]
            data.qpos[:] = mujoco_model.positions_of(particles[:, k.X : k.X + 3], quaternions)
            damping = self.plain.dof_damping.copy()
            self.plain.dof_damping[:] = damping * SETTLE_ZETA_1_S / self.ours.elements.zeta_1_s
            self._mujoco.mj_step(self.plain, data, round(SETTLE_S / self.step_s))
            self.plain.dof_damping[:] = damping
            data.qvel[:] = 0.0
            data.time = 0.0
            self._rests[source] = self.state_of(data)
        return self._rests[source]

    def state_of(self, data: Any) -> Array:
        """MuJoCo's state vector."""
        state = np.empty(self._mujoco.mj_stateSize(self.plain, self._kind))
        self._mujoco.mj_getState(self.plain, data, state, self._kind)
        return state

    def data_of(self, state: Array) -> Any:
        """New `MjData` in a state."""
        data = self._mujoco.MjData(self.plain)
        self._mujoco.mj_setState(self.plain, data, state, self._kind)
        return data

    def step(self, data: Any, steps: int) -> None:
        """Step one robot in place."""
        self._mujoco.mj_step(self.plain, data, steps)

    def rollout(self, threads: int) -> Any:
        """MuJoCo's own pool of threads."""
        return self._rollout.Rollout(nthread=threads)

    def datas(self, model: Any, threads: int) -> list[Any]:
        """New `MjData`, one a thread."""
        return [self._mujoco.MjData(model) for _ in range(threads)]

    def steps_in(self, seconds: float) -> int:
        """Whole steps in so many seconds, at least one."""
        return max(1, round(seconds / self.step_s))

    def strokes(self, policy: Policy) -> Array:
        """Targets of the servos (m), zero at mid stroke."""
        prototype, e = self.ours.prototype, self.ours.elements
        return self.ours.rest_lengths(lengths_of(prototype, policy)) - e.strut_mid_m

    def controls(self, moment: Moment, span_s: float) -> Array:
        """Speeds of the servos for every step of a span, (steps, 6): constant until the target is reached."""
        target = self.strokes(moment.task.policy)
        samples = np.arange(-(-self.steps_in(span_s) // self.steps_in(SAMPLE_S)) + 1) * SAMPLE_S + moment.seconds
        most = self.ours.elements.strut_gain * self.ours.elements.strut_speed_m_s
        path = np.clip(target, -most * samples[:, None], most * samples[:, None])
        return np.repeat(np.diff(path, axis=0) / SAMPLE_S, self.steps_in(SAMPLE_S), axis=0)[: self.steps_in(span_s)]

    def _snapshot(self, moment: Moment) -> Array:
        if moment not in self._snapshots:
            data = self.data_of(self.resting(moment.task.source))
            for control in self.controls(Moment(moment.task, 0.0), moment.seconds):
                data.ctrl[:] = control
                self.step(data, 1)
            self._snapshots[moment] = self.state_of(data)
        return self._snapshots[moment]


class _OneOfTheirs:
    """One robot: `mj_step` with as many steps a call as the control stays the same."""

    def __init__(self, engine: MuJoCo, state: Array, controls: Array):
        self._engine, self._state = engine, state
        each = engine.steps_in(SAMPLE_S)
        self._calls = [(controls[at], min(each, len(controls) - at)) for at in range(0, len(controls), each)]
        self.reset()

    def reset(self) -> None:
        self._data = self._engine.data_of(self._state)

    def run(self) -> None:
        data, step = self._data, self._engine.step
        for control, steps in self._calls:
            data.ctrl[:] = control
            step(data, steps)


class _ManyOfTheirs:
    """Many robots: one `rollout` for the whole span. It starts from the given states each time."""

    def __init__(self, engine: MuJoCo, states: Array, controls: Array, threads: int):
        self._model, self._states, self._controls = engine.plain, states, controls
        self._pool = engine.rollout(threads)
        self._datas = engine.datas(engine.plain, threads)
        self._out = np.empty((*controls.shape[:2], states.shape[1]))

    def reset(self) -> None:
        pass

    def run(self) -> None:
        self._pool.rollout(self._model, self._datas, self._states, self._controls, state=self._out)


def judged(robots: Sequence[MuJoCo], jobs: Sequence[Job | Course], threads: int) -> list[Any]:
    """As `Batch.run`, judged by the very same compiled code; strut forces are not watched."""
    return _Judged(robots, jobs, threads).run()


class _Judged:
    """MuJoCo's robots, watched as ours are: their joints, box and ground forces go into rows like our kernel's, every SAMPLE_S."""

    def __init__(self, robots: Sequence[MuJoCo], jobs: Sequence[Job | Course], threads: int):
        self._jobs, first = jobs, robots[0]
        self._robots = [robots[job.model] for job in jobs]
        self._lay, particles = first.ours.layout, first.ours.assembly.particles
        self._rows, self._work = np.zeros((len(jobs), self._lay.state_rows)), np.zeros((len(jobs), particles * k.WORK_ROWS))
        self._records = np.zeros((len(jobs), w.RECORD))
        self._states = np.array([robot.resting(job.source) for robot, job in zip(self._robots, jobs, strict=True)])
        elements = [robot.ours.elements for robot in self._robots]
        self._reach = np.array([e.strut_gain * e.strut_speed_m_s * SAMPLE_S for e in elements])
        self._steps = first.steps_in(SAMPLE_S)
        self._pool, self._datas = first.rollout(threads), first.datas(first.watched, threads)

    @property
    def _struts(self) -> Array:
        return self._rows[:, self._lay.struts : self._lay.contacts].reshape(len(self._rows), 6, k.STRUT_ROWS)

    def run(self) -> list[RollResult | CourseResult]:
        struts, watch = self._struts, []  # of each robot, what `look` takes
        for i, (robot, job) in enumerate(zip(self._robots, self._jobs, strict=True)):
            ours = robot.ours
            struts[i, :, k.REST] = struts[i, :, k.TARGET] = ours.rest_lengths(neutral_lengths(ours.prototype))
            stages = table_of(ours, job.stages) if isinstance(job, Course) else stages_of(ours, job.policy, job.target)
            watch.append((self._rows[i], self._work[i], self._records[i], rules_of(ours), drive_of(ours), self._lay.struts, stages))
        rolling = np.arange(len(self._jobs))
        self._step(rolling)  # sensors show what was before a step: this one shows the start
        for job, looked in zip(self._jobs, watch, strict=True):
            w.begin(*looked[:-1], face_number(job.source), looked[-1])
        while len(rolling):
            self._step(rolling)
            for i in rolling.tolist():
                w.look(*watch[i])
            rolling = rolling[self._records[rolling, w.PHASE] == w.GOING]
        return [self._result(i) for i in range(len(self._jobs))]

    def _step(self, who: Any) -> None:
        """One SAMPLE_S of the given robots."""
        struts, most = self._struts, self._reach[who]
        rest, target = struts[who, :, k.REST], struts[who, :, k.TARGET]
        gap = np.clip(target - rest, -most, most)
        control = np.repeat((gap / SAMPLE_S)[:, None, :], self._steps, axis=1)
        models = [self._robots[i].watched for i in who.tolist()]
        states, sensors = self._pool.rollout(models, self._datas, self._states[who], control, nstep=self._steps)
        self._states[who] = states[:, -1]
        struts[who, :, k.REST] = np.where(np.abs(target - rest) <= most, target, rest + gap)
        joints, box, velocities, forces = mujoco_model.read_sensors(sensors[:, -1])
        rows = self._rows[:, : self._lay.struts].reshape(len(self._rows), -1, k.PARTICLE_ROWS)
        rows[who, :JOINTS, k.X : k.X + 3], rows[who, -1, k.X : k.X + 3] = joints, box
        rows[who, :JOINTS, k.V : k.V + 3] = velocities
        self._work.reshape(len(self._work), -1, k.WORK_ROWS)[who, :JOINTS, k.NORMAL] = forces

    def _result(self, i: int) -> RollResult | CourseResult:
        ours, job, record = self._robots[i].ours, self._jobs[i], self._records[i]
        center = np.empty(3)
        center_of_mass(self._rows[i], ours.elements.mass_kg, center)
        if isinstance(job, Course):
            return course_result_of(ours, job.stages, record, np.zeros(6), center)
        return result_of(ours, job.source, job.target, job.policy, record, np.zeros(6), center)
