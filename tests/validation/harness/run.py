# SPDX-License-Identifier: Apache-2.0
"""Stepping a structure that the kernel was not made for: outside loads, ramped weights, every state kept."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.model import STEP_MARGIN, Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.stability import NO_GROUND
from sim_core.errors import UnstableStepError
from sim_core.structure.arrays import Array
from sim_core.structure.elements import Elements
from sim_core.structure.parameters import Prototype
from sim_core.structure.rotations import matrix_of


@njit(cache=True)
def _advance_loaded(
    state: Array,
    par: Array,
    work: Array,
    assembly: k.Assembly,
    dt: float,
    zeta: float,
    reach: float,
    load: Array,
    ramp: int,
    step: int,
    steps: int,
) -> None:
    """The kernel's step with forces and moments `load` (P, 6) from outside, grown linearly over the first `ramp` steps."""
    for n in range(step, step + steps):
        k.forces(state, par, work, assembly, dt, reach)
        share = min(1.0, n / ramp) if ramp > 0 else 1.0
        for p in range(assembly.particles):
            for i in range(6):
                work[p * k.WORK_ROWS + k.F + i] += share * load[p, i]
        k.integrate(state, par, work, assembly, dt, zeta)


@njit(cache=True)
def _record(
    state: Array,
    par: Array,
    work: Array,
    assembly: k.Assembly,
    dt: float,
    zeta: float,
    reach: float,
    every: int,
    states: Array,
) -> None:
    """Fill `states` (n, rows): the first is the state now, then one each `every` steps."""
    for n in range(states.shape[0]):
        if n > 0:
            k.advance(state, par, work, assembly, dt, zeta, reach, every)
        states[n] = state


def ready(prototype: Prototype, elements: Elements, slower: float = 1.0) -> Model:
    """A model of these elements at the largest time step that `build_model` accepts, divided by `slower`."""
    try:
        build_model(prototype, _at(elements, 1), allow_slack=True)
    except UnstableStepError as error:
        return build_model(prototype, _at(elements, int(np.ceil(slower / (STEP_MARGIN * error.limit_s)))), allow_slack=True)
    return build_model(prototype, _at(elements, int(np.ceil(slower))), allow_slack=True)


def _at(elements: Elements, steps_per_second: int) -> Elements:
    return replace(elements, steps_per_second=steps_per_second)


class Run:
    """A structure that is stepped; the views `x`, `v`, `q`, `s` (P rows each) may be written.

    Attributes:
        x: positions.
        v: half-step velocities.
        q: quaternions.
        s: half-step spatial spins.
        par: the kernel's table, this run's own copy.
    """

    def __init__(self, model: Model, *, ground: bool = False, zeta_1_s: float = 0.0, dt_s: float | None = None):
        """At rest in the elements' own shape. `dt_s`: instead of the model's, past its guard."""
        self.model, self.zeta_1_s, self.step = model, zeta_1_s, 0
        self.dt_s = model.dt_s if dt_s is None else dt_s
        self.reach_m = model.reach_m if ground else NO_GROUND
        self.state, self.work = Robot(model).rows()
        self.par = model.par.copy()
        self.particles_par[:, k.DT_M] *= self.dt_s / model.dt_s
        rows = self.state[: model.layout.struts].reshape(-1, k.PARTICLE_ROWS)
        self.x, self.v = rows[:, k.X : k.X + 3], rows[:, k.V : k.V + 3]
        self.q, self.s = rows[:, k.Q : k.Q + 4], rows[:, k.S : k.S + 3]

    @property
    def particles_par(self) -> Array:
        """(P, PARTICLE_PAR) view of the particles' rows of `par`."""
        return self.par[: self.model.layout.par_gravity].reshape(-1, k.PARTICLE_PAR)

    @property
    def gravity(self) -> Array:
        """(3,) view of the gravity in `par`, m/s²."""
        at = self.model.layout.par_gravity
        return self.par[at : at + 3]

    @property
    def struts(self) -> Array:
        """(6, STRUT_ROWS) view."""
        lay = self.model.layout
        return self.state[lay.struts : lay.contacts].reshape(6, k.STRUT_ROWS)

    def frames(self) -> Array:
        """Rotation matrices, (P, 3, 3)."""
        return matrix_of(self.q)

    def pushes(self) -> Array:
        """Force and moment on each particle now, (P, 6); friction's memory is left alone."""
        work = self.work.copy()
        k.forces(self.state.copy(), self.par, work, self.model.assembly, self.dt_s, self.reach_m)
        return work.reshape(-1, k.WORK_ROWS)[:, k.F : k.M + 3]

    def begin(self) -> None:
        """Take the velocities and spins as those of now, and set them back by half a step: the leapfrog's start of order 2."""
        pushes = self.pushes()
        self.v -= 0.5 * self.particles_par[:, k.DT_M, None] * pushes[:, :3]
        self.s -= 0.5 * self.dt_s * pushes[:, 3:]

    def advance(self, steps: int) -> None:
        """Take steps without outside loads."""
        m = self.model
        k.advance(self.state, self.par, self.work, m.assembly, self.dt_s, self.zeta_1_s, self.reach_m, steps)
        self.step += steps

    def advance_loaded(self, steps: int, load: Array, ramp: int = 0) -> None:
        """Take steps under forces and moments (P, 6) that grow over the first `ramp` steps of the run."""
        m = self.model
        _advance_loaded(
            self.state, self.par, self.work, m.assembly, self.dt_s, self.zeta_1_s, self.reach_m, load, ramp, self.step, steps
        )  # fmt: skip
        self.step += steps

    def record(self, samples: int, every: int = 1) -> Array:
        """Step on and keep the particles' rows, (samples, P, PARTICLE_ROWS): the first are those of now."""
        m = self.model
        states = np.empty((samples, len(self.state)))
        _record(self.state, self.par, self.work, m.assembly, self.dt_s, self.zeta_1_s, self.reach_m, every, states)
        self.step += (samples - 1) * every
        return states[:, : m.layout.struts].reshape(samples, -1, k.PARTICLE_ROWS)


def angular_frequency(track: NDArray[np.float64], period_s: float) -> float:
    """Angular frequency of a sinusoid sampled each `period_s` (least squares of x₊ + x₋ = 2 cos(ωΔ) x)."""
    middle = track[1:-1]
    return float(np.arccos(0.5 * np.dot(track[2:] + track[:-2], middle) / np.dot(middle, middle)) / period_s)
