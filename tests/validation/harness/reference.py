# SPDX-License-Identifier: Apache-2.0
"""The robot's equations of motion a second time, without the kernel.

Energy by its formulas, forces as its derivatives by complex step (exact to round-off, no cancellation), motion by a high-order
integrator. Slow and plain on purpose.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_core.structure.arrays import Array
from sim_core.structure.elements import Elements

Numbers = NDArray[Any]
"""Real or complex."""
_STEP = 1e-30


def _length(vector: Numbers) -> Numbers:
    """Norm over the last axis that stays analytic for complex numbers."""
    return np.asarray(np.sqrt((vector * vector).sum(axis=-1)))


def elastic_energy(e: Elements, rest_m: Array, x: Numbers, r: Numbers) -> Numbers:
    """U of beams and cables for any number of shapes at once: x (..., P, 3), r (..., P, 3, 3), the struts' rest lengths (6,)."""
    first, second = e.beam_ends.T
    rest = rest_m[e.beam_strut] * e.beam_share
    chord = x[..., second, :] - x[..., first, :]
    length = _length(chord)
    along = chord / length[..., None]
    r1, r2 = r[..., first, :, :], r[..., second, :, :]
    t1, t2 = np.cross(along, r1[..., 0]), np.cross(along, r2[..., 0])
    twist = 0.5 * ((r2[..., 1] * r1[..., 2]).sum(axis=-1) - (r2[..., 2] * r1[..., 1]).sum(axis=-1))
    bend = (t1 * t1 + t1 * t2 + t2 * t2).sum(axis=-1)
    beams = 0.5 * e.beam_ea_n / rest * (length - rest) ** 2 + 2.0 * e.beam_ei_n_m2 / rest * bend
    beams = beams + 0.5 * e.beam_gj_n_m2 / rest * twist**2
    a, b = e.cable_ends.T
    gap = x[..., b, :] + np.einsum("...nij,nj->...ni", r[..., b, :, :], e.cable_point_2_m)
    gap = gap - x[..., a, :] - np.einsum("...nij,nj->...ni", r[..., a, :, :], e.cable_point_1_m)
    stretch = _length(gap) - e.cable_rest_m
    cables = 0.5 * e.cable_stiffness_n_m * np.where(stretch.real > 0.0, stretch, 0.0) ** 2
    return np.asarray(beams.sum(axis=-1) + cables.sum(axis=-1))


def elastic_forces(e: Elements, rest_m: Array, x: Array, r: Array) -> Array:
    """(P, 6): minus the derivatives of U by displacement and spatial rotation of each particle."""
    particles = len(x)
    xs = np.repeat(x[None].astype(complex), 6 * particles, axis=0)
    rs = np.repeat(r[None].astype(complex), 6 * particles, axis=0)
    for p in range(particles):
        for axis in range(3):
            xs[6 * p + axis, p, axis] += 1j * _STEP
            rs[6 * p + 3 + axis, p] += 1j * _STEP * np.cross(np.eye(3)[axis], r[p], axisb=0).T
    energies: Array = elastic_energy(e, rest_m, xs, rs).imag
    return -energies.reshape(particles, 6) / _STEP


def turn_rates(e: Elements, r: Array, spin: Array) -> Array:
    """(P, 3) angular velocities ω = R I⁻¹ Rᵀ s."""
    return np.asarray(np.einsum("nij,nj,nkj,nk->ni", r, 1.0 / e.inertia_kg_m2, r, spin))


def kinetic_energy(e: Elements, r: Array, v: Array, spin: Array) -> float:
    """Of translation and rotation."""
    return float(0.5 * (e.mass_kg[:, None] * v**2).sum() + 0.5 * (turn_rates(e, r, spin) * spin).sum())


def motion(e: Elements, rest_m: Array, start: tuple[Array, Array, Array, Array], seconds: float) -> tuple[Array, Array]:
    """Positions (P, 3) and rotation matrices (P, 3, 3) after a free motion without gravity, ground and damping.

    `start`: x (P, 3), v (P, 3), r (P, 3, 3), spatial spin s (P, 3).
    """
    particles = len(e.mass_kg)
    cuts = np.cumsum([3 * particles, 3 * particles, 9 * particles])

    def rates(_: float, y: Array) -> Array:
        x, v, r, spin = (part.reshape(particles, -1) for part in np.split(y, cuts))
        matrices = r.reshape(particles, 3, 3)
        push = elastic_forces(e, rest_m, x, matrices)
        turning = np.cross(turn_rates(e, matrices, spin)[:, None, :], matrices.transpose(0, 2, 1)).transpose(0, 2, 1)
        return np.concatenate([v.ravel(), (push[:, :3] / e.mass_kg[:, None]).ravel(), turning.ravel(), push[:, 3:].ravel()])

    begin = np.concatenate([part.ravel() for part in start])
    end = solve_ivp(rates, (0.0, seconds), begin, method="DOP853", rtol=1e-10, atol=1e-12, t_eval=[seconds]).y[:, -1]
    return end[: cuts[0]].reshape(-1, 3), end[cuts[1] : cuts[2]].reshape(-1, 3, 3)
