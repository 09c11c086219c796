# SPDX-License-Identifier: Apache-2.0
"""The previous model's way through a roll: quasi-static steps, each relaxed with kinetic damping.

Rest lengths change by at most INCREMENT_M at a time, all struts together, each stopping at its own target. After each change
the robot is relaxed: undamped steps, all velocities set to zero whenever the kinetic energy passes a peak, until no joint feels a
net force above the tolerance.

Compiled for one robot or eight lanes; velocities are reset lane by lane.
"""

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.simd import larger, load, select, store
from sim_core.rolling import roll_monitor as w
from sim_core.structure.arrays import Array

INCREMENT_M = 0.001
RESIDUAL = 1e-4
"""Largest net force on a particle at rest / tendon pretension."""
LOOK_STEPS = 10
"""The residual is looked at once in so many steps."""
MOST_LOOKS = 4000
"""Looks after which a relaxation is given up: not settled."""

# Rows of the track that goes with a state: kinetic energy (× 2) at the last step, largest squared net force at the last step, and 1
# if the velocities were not just reset (0: the next step starts from rest).
ENERGY, NET_FORCE, MOVING, TRACK_ROWS = 0, 1, 2, 3


@njit(cache=True)
def relax(state: Array, par: Array, work: Array, track: Array, assembly: k.Assembly, dt: float, reach: float, steps: int) -> None:
    """Take steps of kinetic damping in place; `track` (TRACK_ROWS rows) starts at zero."""
    particles = assembly.particles
    for _ in range(steps):
        k.forces(state, par, work, assembly, dt, reach)
        worst = load(track, NET_FORCE) * 0.0
        for p in range(particles):
            f = p * k.WORK_ROWS + k.F
            fx, fy, fz = load(work, f), load(work, f + 1), load(work, f + 2)
            worst = larger(worst, fx * fx + fy * fy + fz * fz)
        store(track, NET_FORCE, worst)
        k.integrate(state, par, work, assembly, dt, 0.0)
        energy = worst * 0.0
        # a step from rest takes half a kick (central difference started with v = 0): a full one would feed the stiff modes
        kick = select(load(track, MOVING) > 0.5, 1.0, 0.5)
        for p in range(particles):
            x = p * k.PARTICLE_ROWS + k.X
            v = p * k.PARTICLE_ROWS + k.V
            for axis in range(3):
                full = load(state, v + axis)
                store(state, v + axis, kick * full)
                store(state, x + axis, load(state, x + axis) + dt * (kick * full - full))
            vx, vy, vz = load(state, v), load(state, v + 1), load(state, v + 2)
            energy = energy + (vx * vx + vy * vy + vz * vz) / load(par, p * k.PARTICLE_PAR + k.DT_M)
        past_peak = energy < load(track, ENERGY)
        for p in range(particles):
            for axis in range(3):
                v = p * k.PARTICLE_ROWS + k.V + axis
                store(state, v, select(past_peak, 0.0, load(state, v)))
                s = p * k.PARTICLE_ROWS + k.S + axis
                store(state, s, select(past_peak, 0.0, load(state, s)))
        store(track, ENERGY, select(past_peak, 0.0, energy))
        store(track, MOVING, select(past_peak, 0.0, 1.0))


@njit(cache=True)
def step_lengths(state: Array, struts: int) -> bool:
    """Bring every rest length nearer to its target by at most INCREMENT_M; True if any moved."""
    moved = False
    for s in range(6):
        row = struts + s * k.STRUT_ROWS
        gap = state[row + k.TARGET] - state[row + k.REST]
        if gap != 0.0:
            moved = True
            if abs(gap) <= INCREMENT_M:
                state[row + k.REST] = state[row + k.TARGET]
            else:
                state[row + k.REST] += INCREMENT_M if gap > 0.0 else -INCREMENT_M
    return moved


@njit(cache=True)
def look(
    state: Array, work: Array, track: Array, record: Array, rules: w.Rules, struts: int, stages: Array, tolerance: float
) -> None:
    """One look at a relaxation that goes on: once it is over, change the lengths further, or go on to the next stage or the end.

    Args:
        state: this robot's column.
        work: this robot's column.
        track: this robot's column.
        record: the roll's course, see `roll_monitor`.
        rules: what is judged by.
        struts: first of the struts' rows in `state`.
        stages: of the course, each of which ends at rest.
        tolerance: of the net force, squared.
    """
    record[w.SAMPLES] += 1
    record[w.WAITED] += 1
    if not np.isfinite(track[NET_FORCE]):
        record[w.PHASE] = w.DIVERGED
        return
    settled = track[NET_FORCE] <= tolerance
    if not settled and record[w.WAITED] < MOST_LOOKS:
        return
    bits, face, margin = w.see(state, work, record, rules)
    for s in range(6):
        record[w.REST_FORCE] = max(record[w.REST_FORCE], abs(state[struts + s * k.STRUT_ROWS + k.AXIAL]))
    if settled and step_lengths(state, struts):
        record[w.WAITED] = 0
        track[ENERGY] = 0.0
        return
    w.end_at_rest(state, record, rules, struts, stages, bits, face, margin, settled)
    if record[w.PHASE] == w.GOING:
        step_lengths(state, struts)
