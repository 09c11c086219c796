# SPDX-License-Identifier: Apache-2.0
"""A body that nothing acts on keeps what mechanics says it keeps."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.rotations import matrix_of
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.reference import elastic_energy, kinetic_energy
from tests.validation.harness.run import Run

SPIN_RAD_S = np.array([1.0, -2.0, 3.0])
DRIFT_M_S = np.array([0.03, -0.02, 0.01])
OWN_SPIN_RAD_S = 50.0
FULL_STEPS, SHORT_STEPS = 1_000_000, 100_000
ENERGY_S = 10.0


def tumbling(prototype: Prototype, shake_m_s: float = 0.02, own_spin_rad_s: float = 0.0) -> Run:
    """The robot, floating free: it drifts, tumbles and shakes, and no two principal inertias of its particles are equal.

    Every particle gets a random velocity, and spins by itself, up to the given ones: so struts bend and twist, out of one plane.
    """
    free = replace(
        prototype,
        gravity_m_s2=0.0,
        mass_damping_ratio=0.0,
        box_inertia_kg_m2=tuple(np.multiply(prototype.box_inertia_kg_m2, (0.8, 1.1, 1.4))),
        joint_inertia_kg_m2=tuple(np.multiply(prototype.joint_inertia_kg_m2, (1.0, 1.2, 1.6))),
    )
    run, rng = Run(build_model(free)), np.random.default_rng(3)
    e, frames = run.model.elements, run.frames()
    run.v[:] = DRIFT_M_S + np.cross(SPIN_RAD_S, run.x) + shake_m_s * rng.uniform(-1.0, 1.0, run.x.shape)
    run.s[:] = np.einsum("nij,nj,nkj,k->ni", frames, e.inertia_kg_m2, frames, SPIN_RAD_S)
    run.s += e.inertia_kg_m2 * rng.uniform(-own_spin_rad_s, own_spin_rad_s, run.s.shape)
    run.begin()
    return run


class _Kept(NamedTuple):
    steps: list[int]
    linear: list[float]
    angular: list[float]


@lru_cache(maxsize=2)
def _momenta(setting: Setting) -> _Kept:
    """Relative change of both momenta over the run."""
    run = tumbling(setting.prototype, own_spin_rad_s=OWN_SPIN_RAD_S)
    mass = run.model.elements.mass_kg[:, None]

    def momenta() -> tuple[Array, Array]:
        # velocities belong to the half step: angular momentum takes the middle of the positions on either side
        before = run.x.copy()
        run.advance(1)
        momentum = mass * run.v
        return momentum.sum(axis=0), (np.cross(0.5 * (before + run.x), momentum) + run.s).sum(axis=0)

    linear, angular = momenta()
    kept = _Kept([], [], [])
    every = (FULL_STEPS if setting.full else SHORT_STEPS) // 50
    for _ in range(50):
        run.advance(every - 1)
        now = momenta()
        kept.steps.append(run.step)
        kept.linear.append(float(np.linalg.norm(now[0] - linear) / np.linalg.norm(linear)))
        kept.angular.append(float(np.linalg.norm(now[1] - angular) / np.linalg.norm(angular)))
    return kept


def linear_momentum(setting: Setting) -> Case:
    """Largest change."""
    kept = _momenta(setting)
    return Case(
        "free body: linear momentum",
        f"Largest relative change of Σ m v of the floating, tumbling, shaking robot over {kept.steps[-1]:,} steps.",
        "conservation of momentum",
        Comparison(max(kept.linear), 0.0, "1", 1e-9, relative=False),
    )


def angular_momentum(setting: Setting) -> Case:
    """Largest change."""
    kept = _momenta(setting)
    return Case(
        "free body: angular momentum",
        f"Largest relative change of Σ (x × m v + s) about a fixed point, unequal inertias, over {kept.steps[-1]:,} steps.",
        "conservation of angular momentum; s is the spatial spin",
        Comparison(max(kept.angular), 0.0, "1", 1e-9, relative=False),
        picture=Picture(
            "steps",
            "relative change",
            (Curve("linear momentum", kept.steps, kept.linear), Curve("angular momentum", kept.steps, kept.angular)),
        ),
    )


def energy(setting: Setting) -> Case:
    """Free vibration: energy at whole steps, the velocities' squares averaged over both neighbouring half steps."""
    run = tumbling(setting.prototype, 0.05)
    e = run.model.elements
    rest = e.strut_mid_m
    samples, every = 400, round(ENERGY_S / 400 / run.dt_s)
    times, total = [], []
    for _ in range(samples):
        rows = run.record(2)
        now, after = rows[0], rows[1]
        r = matrix_of(now[:, k.Q : k.Q + 4])
        kinetic = 0.5 * sum(kinetic_energy(e, r, row[:, k.V : k.V + 3], row[:, k.S : k.S + 3]) for row in (now, after))
        times.append((run.step - 1) * run.dt_s)
        total.append(kinetic + float(elastic_energy(e, rest, now[:, k.X : k.X + 3], r)))
        run.advance(every - 1)
    change = np.array(total) / total[0] - 1.0
    return Case(
        "free body: energy",
        f"Largest relative change of kinetic + elastic energy of the undamped, vibrating, tumbling robot in {ENERGY_S:g} s.",
        "conservation of energy; elastic energy by the potentials in docs/model.md, not by the kernel",
        Comparison(float(np.abs(change).max()), 0.0, "1", 0.01, relative=False),
        note=f"Its drift is {np.polyfit(times, change, 1)[0] * ENERGY_S:.1e} in {ENERGY_S:g} s; the rest is the "
        "leapfrog's bounded ripple.",
        picture=Picture("time (s)", "relative change of energy", (Curve("kinetic + elastic", times, change.tolist()),)),
    )
