# SPDX-License-Identifier: Apache-2.0
"""The largest stable time step, from the model itself: 2 / ω_max of the linearised system."""

from collections.abc import Iterable

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from sim_core.structure.elements import Elements
from sim_core.structure.rotations import quaternion_of
from sim_core.structure.topology import POINTS_PER_JOINT

NO_GROUND = -1e9
"""As the kernel's `reach`: no joint is low enough to touch."""


def stiffness(state: Array, par: Array, assembly: k.Assembly) -> Array:
    """Stiffness matrix of the elements (ground and gravity left out) about a state, by central differences of the kernel.

    (6P, 6P): rows are −force and −moment, columns displacement and spatial rotation, particle by particle.
    """
    particles = assembly.particles
    step, columns = 1e-7, []
    work = np.zeros(particles * k.WORK_ROWS)
    for p in range(particles):
        for axis in range(6):
            sides = []
            for sign in (1.0, -1.0):
                moved = state.copy()
                x = p * k.PARTICLE_ROWS
                if axis < 3:
                    moved[x + k.X + axis] += sign * step
                else:
                    spin = np.zeros(3)
                    spin[axis - 3] = 1.0
                    q = moved[x + k.Q : x + k.Q + 4]
                    q[:] = k.turned(q[0], q[1], q[2], q[3], spin[0], spin[1], spin[2], 0.5 * sign * step)
                k.forces(moved, par, work, assembly, 1.0, NO_GROUND)
                table = work.reshape(particles, k.WORK_ROWS)
                sides.append(np.concatenate([table[:, k.F : k.F + 3], table[:, k.M : k.M + 3]], axis=1).ravel())
            columns.append((sides[1] - sides[0]) / (2.0 * step))
    return np.array(columns).T


def ground_stiffness(e: Elements, frames: Array, points: Iterable[int]) -> Array:
    """Stiffness of closed, sticking contacts at contact points with these indices, (6P, 6P); `frames`: (P, 3, 3)."""
    particles = len(e.mass_kg)
    total = np.zeros((6 * particles, 6 * particles))
    normal, tangential = e.ground_stiffness_n_m
    springs = np.diag([tangential, tangential, normal])
    for point in points:
        joint = point // POINTS_PER_JOINT
        r = frames[joint] @ e.contact_point_m[point]
        lever = np.array([[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]])
        jacobian = np.hstack([np.eye(3), lever])
        at = slice(6 * joint, 6 * joint + 6)
        total[at, at] += jacobian.T @ springs @ jacobian
    return total


def mass_diagonal(e: Elements) -> Array:
    """Masses and inertias per degree of freedom, (6P,); the smallest inertia of a particle stands for all its axes."""
    smallest = np.repeat(e.inertia_kg_m2.min(axis=1)[:, None], 3, axis=1)
    mass = e.mass_factor * e.mass_kg
    return np.concatenate([np.repeat(mass[:, None], 3, axis=1), smallest], axis=1).ravel()


def largest_stable_step_s(e: Elements, assembly: k.Assembly, par: Array, stroke_m: float) -> float:
    """2 / ω_max with every strut at its shortest and every contact closed (central difference's limit)."""
    particles, lay = assembly.particles, k.layout(assembly.particles, len(assembly.beams), len(assembly.cables))
    shortest = e.strut_mid_m - e.strut_gain * stroke_m
    state = np.zeros(lay.state_rows)
    table = state[: particles * k.PARTICLE_ROWS].reshape(particles, k.PARTICLE_ROWS)
    table[:, k.X : k.X + 3] = e.position_m
    table[:, k.Q : k.Q + 4] = [quaternion_of(frame) for frame in e.frame]
    struts = state[lay.struts : lay.contacts].reshape(6, k.STRUT_ROWS)
    struts[:, k.REST] = shortest
    for strut in range(6):  # draw the strut's particles together along its axis
        chain = np.unique(e.beam_ends[e.beam_strut == strut])
        middle = e.position_m[chain].mean(axis=0)
        table[chain, k.X : k.X + 3] = middle + (e.position_m[chain] - middle) * shortest[strut] / e.strut_mid_m[strut]
    total: Array = stiffness(state, par, assembly)
    total += ground_stiffness(e, e.frame, range(k.CONTACTS))
    scale = 1.0 / np.sqrt(mass_diagonal(e))
    omega_squared = np.linalg.eigvalsh(0.5 * scale[:, None] * (total + total.T) * scale[None, :])[-1]
    return float(2.0 / np.sqrt(omega_squared))
