# SPDX-License-Identifier: Apache-2.0
"""Watching a roll while it is simulated: the compiled half of `roll`, the same for one robot and for a robot in a lane.

A roll's course is kept in a *record*, a row of numbers. `look` is called every SAMPLE_S of simulated time: it updates the record
and, once the robot is at rest after actuation on the wanted face, sends the struts back to neutral.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.footing import FACE_JOINTS, FACE_OF_JOINTS, STRUT_ENDS, base, center_of_mass, clearance, past_edges
from sim_core.dynamics.jit_cache import njit
from sim_core.structure.arrays import Array

SAMPLE_S = 0.01
"""Footing, clearance and rest are looked at this often. Strut forces are watched at every step."""

# Places in a record. Phase: see below. Aim: number of the wanted face, −1 for whatever it lands on; source: of the first face.
PHASE, AIM, SOURCE, QUIET, WAITED, SAMPLES, CLEARANCE = 0, 1, 2, 3, 4, 5, 6
# Footing at rest after actuation and after the return: joints' bit mask, face number, margin.
ACTUATED, RETURNED = 7, 10
# Raw neutral lengths of the struts. Starting centre of mass. Faces stood on: how many, then their numbers.
NEUTRAL, START, FACES_SEEN, FACE_LIST = 13, 19, 22, 23
MOST_FACES = 24
# Largest strut force at the rests of a quasi-static roll.
REST_FORCE = FACE_LIST + MOST_FACES
# How far the centre of mass got past each edge of the first face, before it stood on another.
PAST_EDGES = REST_FORCE + 1
RECORD = PAST_EDGES + 3

# Phases.
ACTUATING, RETURNING, DONE, TIMED_OUT_ACTUATING, TIMED_OUT_RETURNING, DIVERGED = 0, 1, 2, 3, 4, 5


class Rules(NamedTuple):
    """What `look` judges by: SI units; counts are numbers of samples."""

    mass: Array
    """(P,) of this robot."""
    carry_n: float
    down: Array
    rest_speed_m_s: float
    hold_samples: int
    timeout_samples: int
    strut_diameter_m: float
    box_radius_m: float
    particles: int
    face_of_joints: NDArray[np.int8] = FACE_OF_JOINTS
    face_joints: NDArray[np.int64] = FACE_JOINTS
    strut_ends: NDArray[np.int32] = STRUT_ENDS


@njit(cache=True)
def begin(state: Array, work: Array, record: Array, rules: Rules, struts: int, source: int, aim: int, neutral: Array) -> None:
    """Start a record for the robot in `state`; `neutral` (6,) are the struts' own neutral lengths."""
    record[:] = 0.0
    record[PHASE] = ACTUATING
    record[AIM] = aim
    record[SOURCE] = source
    record[CLEARANCE] = np.inf
    record[PAST_EDGES : PAST_EDGES + 3] = -np.inf
    record[ACTUATED + 1] = record[RETURNED + 1] = -1
    record[ACTUATED + 2] = record[RETURNED + 2] = np.nan
    for s in range(6):
        record[NEUTRAL + s] = neutral[s]
        state[struts + s * k.STRUT_ROWS + k.PEAK] = 0.0
    center = np.empty(3)
    center_of_mass(state, rules.mass, center)
    for axis in range(3):  # not a slice: its check of shapes takes seconds to compile
        record[START + axis] = center[axis]
    see(state, work, record, rules)


@njit(cache=True)
def see(state: Array, work: Array, record: Array, rules: Rules) -> tuple[int, int, float]:
    """Clearance and footing now, into the record; returns (bits, face, margin)."""
    joints, forces = np.empty((12, 3)), np.empty(12)
    for joint in range(12):
        for axis in range(3):
            joints[joint, axis] = state[joint * k.PARTICLE_ROWS + k.X + axis]
        forces[joint] = work[joint * k.WORK_ROWS + k.NORMAL]
    box, center = np.empty(3), np.empty(3)
    for axis in range(3):
        box[axis] = state[(rules.particles - 1) * k.PARTICLE_ROWS + k.X + axis]
    record[CLEARANCE] = min(record[CLEARANCE], clearance(joints, box, rules.strut_ends, rules.strut_diameter_m, rules.box_radius_m))
    center_of_mass(state, rules.mass, center)
    bits, face, margin = base(joints, center, forces, rules.carry_n, rules.down, rules.face_of_joints)
    seen = int(record[FACES_SEEN])
    if seen <= 1:
        corners = rules.face_joints[int(record[SOURCE])]
        past_edges(joints, center, rules.down, corners, record[PAST_EDGES : PAST_EDGES + 3])
    if face >= 0 and seen < MOST_FACES and (seen == 0 or record[FACE_LIST + seen - 1] != face):
        record[FACE_LIST + seen] = face
        record[FACES_SEEN] = seen + 1
    return bits, face, margin


@njit(cache=True)
def look(state: Array, work: Array, record: Array, rules: Rules, struts: int) -> None:
    """One sample of a roll that is not over: update the record, and go on to the return or to the end when it is time."""
    record[SAMPLES] += 1
    finite = True
    fastest = 0.0
    for joint in range(12):
        v = joint * k.PARTICLE_ROWS + k.V
        square = state[v] * state[v] + state[v + 1] * state[v + 1] + state[v + 2] * state[v + 2]
        finite = finite and np.isfinite(square)
        fastest = max(fastest, square)
    if not finite:
        record[PHASE] = DIVERGED
        return
    bits, face, margin = see(state, work, record, rules)
    driving = False
    for s in range(6):
        row = struts + s * k.STRUT_ROWS
        driving = driving or state[row + k.REST] != state[row + k.TARGET]
    if driving:
        record[QUIET] = record[WAITED] = 0
        return
    record[WAITED] += 1
    record[QUIET] = record[QUIET] + 1 if fastest < rules.rest_speed_m_s * rules.rest_speed_m_s else 0
    at_rest = record[QUIET] >= rules.hold_samples
    if not at_rest and record[WAITED] < rules.timeout_samples:
        return
    end_of_phase(state, record, struts, bits, face, margin, at_rest)


@njit(cache=True)
def end_of_phase(state: Array, record: Array, struts: int, bits: int, face: int, margin: float, at_rest: bool) -> None:
    """The robot has come to rest, or has not in time: keep its footing; go on to the return, or end."""
    returning = record[PHASE] == RETURNING
    place = RETURNED if returning else ACTUATED
    record[place], record[place + 1], record[place + 2] = bits, face, margin
    record[QUIET] = record[WAITED] = 0
    if not at_rest:
        record[PHASE] = TIMED_OUT_RETURNING if returning else TIMED_OUT_ACTUATING
        return
    if not returning and record[AIM] < 0:
        record[AIM] = face
    if returning or face < 0 or face != record[AIM] or face == record[SOURCE]:
        record[PHASE] = DONE
        return
    record[PHASE] = RETURNING
    for s in range(6):
        state[struts + s * k.STRUT_ROWS + k.TARGET] = record[NEUTRAL + s]
