# SPDX-License-Identifier: Apache-2.0
"""Watching a course of motions while it is simulated: compiled, the same for one robot and for a robot in a lane.

A course is a table of *stages*, a row each: lengths to drive to, and when to go on. A roll has two (actuate, return to neutral),
both until the robot is at rest; a chain of rolls goes on while it moves. What happens is kept in a *record*, a row of numbers.
`look` is called every SAMPLE_S of simulated time: it updates the record, and sends the struts on when the next stage is due.

Struts are the solver's own, which go to where they are sent whatever the load; or they follow actuators that feel it
(`dynamics.actuators`), to which the lengths are told at constant speed, as the bridge tells them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.actuators import Numbers, one_after
from sim_core.dynamics.footing import FACE_JOINTS, FACE_OF_JOINTS, STRUT_ENDS, base, center_of_mass, clearance, past_edges, under
from sim_core.dynamics.jit_cache import njit
from sim_core.structure.arrays import Array

SAMPLE_S = 0.01
"""Footing, clearance and rest are looked at this often. Strut forces are watched at every step."""

LOOK_SAMPLES = 5
"""In motion somebody looks so often where the robot stands: an observer does, every 50 ms."""

# Places in a stage's row: raw lengths to drive to; number of the face that it leads onto (−1: whatever it lands on); then samples.
# A stage ends at rest (AT_REST), or else (ON_TIME) LEAST after its beginning, and if SEEN is not negative no sooner than so long
# after the robot first stood on the face; a chain whose robot does not within LIMIT of the beginning has missed.
GOALS, ONTO, ENDS, LEAST, SEEN, LIMIT, STAGE_ROWS = 0, 6, 7, 8, 9, 10, 11
AT_REST, ON_TIME = 0, 1

# Places in a record. Phase: see below. Stage: which one goes on. Source: number of the first face.
PHASE, STAGE, SOURCE, QUIET, WAITED, SAMPLES, CLEARANCE = 0, 1, 2, 3, 4, 5, 6
# Footing at the first and at the last rest: joints' bit mask, face number, margin.
ACTUATED, RETURNED = 7, 10
# Samples since the stage began, and since the robot stood on the stage's face. Rests so far. Faces reached in the course's order.
ELAPSED, LANDED, RESTS, REACHED = 13, 14, 15, 16
# When the first and the last face were reached, and where the centre of mass was then: sample, x, y.
FIRST_LANDING, LAST_LANDING = 17, 20
# Samples in which each strut was driven.
DRIVEN = 23
# Starting centre of mass. Faces stood on: how many, then their numbers.
START, FACES_SEEN, FACE_LIST = 29, 32, 33
MOST_FACES = 48
# Largest strut force at the rests of a quasi-static roll.
REST_FORCE = FACE_LIST + MOST_FACES
# How far the centre of mass got past each edge of the first face, before it stood on another.
PAST_EDGES = REST_FORCE + 1
# Actuators that feel their load: what each is told now, the length of its screw, its averaged load; the supply's voltage.
TOLD, SCREW, LOAD, SUPPLY = PAST_EDGES + 3, PAST_EDGES + 9, PAST_EDGES + 15, PAST_EDGES + 21
RECORD = SUPPLY + 1

# Phases.
GOING, DONE, TIMED_OUT, MISSED, DIVERGED = 0, 1, 2, 3, 4


class Drive(NamedTuple):
    """What becomes of the lengths that a stage goes for.

    Attributes:
        feels: actuators feel their load; else nothing below matters.
        p: their numbers.
        keep: how much of the averaged load is left after SAMPLE_S.
        reach: how far each strut's told length goes in SAMPLE_S, (6,) of this robot.
        mid: its struts' lengths at mid stroke, (6,).
        strength: its actuators' own factors, (6,).
    """

    feels: bool
    p: Numbers
    keep: float
    reach: Array
    mid: Array
    strength: Array


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


one_actuator = njit(cache=True, error_model="numpy")(one_after)


@njit(cache=True)
def _drive(state: Array, record: Array, drive: Drive, struts: int, stages: Array) -> None:
    """Six actuators for the SAMPLE_S that begins: as `actuators.step`, towards lengths that are told at constant speed."""
    ratio, stage, current = record[SUPPLY] / drive.p.supply_nominal_v, int(record[STAGE]), 0.0
    for s in range(6):
        row = struts + s * k.STRUT_ROWS
        goal, told = stages[stage, GOALS + s], record[TOLD + s]
        told = goal if abs(goal - told) <= drive.reach[s] else told + (drive.reach[s] if goal > told else -drive.reach[s])
        force = state[row + k.AXIAL]
        load = force + (record[LOAD + s] - force) * drive.keep
        screw, drawn, _, _ = one_actuator(drive.p, ratio, SAMPLE_S, record[SCREW + s], told, load, drive.mid[s], drive.strength[s])
        record[TOLD + s], record[LOAD + s], record[SCREW + s] = told, load, screw
        side = min(max(load / drive.p.play_load_n, -1.0), 1.0)
        state[row + k.TARGET] = screw + 0.5 * drive.p.play_m * side
        current += drawn
        if drawn > 0.0:
            record[DRIVEN + s] += 1
    record[SUPPLY] = max(0.0, drive.p.supply_open_v - drive.p.supply_resistance_ohm * current)


@njit(cache=True)
def begin(state: Array, work: Array, record: Array, rules: Rules, drive: Drive, struts: int, source: int, stages: Array) -> None:
    """Start a record for the robot in `state`, and the first of its `stages` (n, STAGE_ROWS)."""
    record[:] = 0.0
    record[SOURCE] = source
    record[CLEARANCE] = np.inf
    record[PAST_EDGES : PAST_EDGES + 3] = -np.inf
    record[ACTUATED + 1] = record[RETURNED + 1] = -1
    record[ACTUATED + 2] = record[RETURNED + 2] = np.nan
    center = np.empty(3)
    center_of_mass(state, rules.mass, center)
    for axis in range(3):  # not a slice: its check of shapes takes seconds to compile
        record[START + axis] = center[axis]
    for s in range(6):
        row = struts + s * k.STRUT_ROWS
        state[row + k.PEAK] = 0.0
        state[row + k.TARGET] = stages[0, GOALS + s]
        record[TOLD + s] = record[SCREW + s] = state[row + k.REST]
        record[LOAD + s] = state[row + k.AXIAL]
    record[SUPPLY] = drive.p.supply_open_v
    see(state, work, record, rules)
    if drive.feels:
        _drive(state, record, drive, struts, stages)


@njit(cache=True)
def see(state: Array, work: Array, record: Array, rules: Rules) -> tuple[int, int, float]:
    """Clearance and footing now, into the record; returns (bits, face, margin)."""
    joints, forces, box, center = np.empty((12, 3)), np.empty(12), np.empty(3), np.empty(3)
    _where(state, rules, joints, center)
    for joint in range(12):
        forces[joint] = work[joint * k.WORK_ROWS + k.NORMAL]
    for axis in range(3):
        box[axis] = state[(rules.particles - 1) * k.PARTICLE_ROWS + k.X + axis]
    record[CLEARANCE] = min(record[CLEARANCE], clearance(joints, box, rules.strut_ends, rules.strut_diameter_m, rules.box_radius_m))
    bits, face, margin = base(joints, center, forces, rules.carry_n, rules.down, rules.face_of_joints)
    seen = int(record[FACES_SEEN])
    if seen <= 1:
        corners = rules.face_joints[int(record[SOURCE])]
        past_edges(joints, center, rules.down, corners, record[PAST_EDGES : PAST_EDGES + 3])
    _stood_on(record, face)
    return bits, face, margin


@njit(cache=True)
def _where(state: Array, rules: Rules, joints: Array, center: Array) -> None:
    """The joints, (12, 3), and the centre of mass."""
    for joint in range(12):
        for axis in range(3):
            joints[joint, axis] = state[joint * k.PARTICLE_ROWS + k.X + axis]
    center_of_mass(state, rules.mass, center)


@njit(cache=True)
def _stood_on(record: Array, face: int) -> None:
    seen = int(record[FACES_SEEN])
    if face >= 0 and seen < MOST_FACES and (seen == 0 or record[FACE_LIST + seen - 1] != face):
        record[FACE_LIST + seen] = face
        record[FACES_SEEN] = seen + 1


@njit(cache=True)
def look(state: Array, work: Array, record: Array, rules: Rules, drive: Drive, struts: int, stages: Array) -> None:
    """One sample of a course that is not over: update the record, and go on to the next stage or to the end when it is time."""
    _judge(state, work, record, rules, drive.feels, struts, stages)
    if drive.feels and record[PHASE] == GOING:
        _drive(state, record, drive, struts, stages)


@njit(cache=True)
def _judge(state: Array, work: Array, record: Array, rules: Rules, feels: bool, struts: int, stages: Array) -> None:
    record[SAMPLES] += 1
    record[ELAPSED] += 1
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
    driving, stage = False, int(record[STAGE])
    for s in range(6):
        row = struts + s * k.STRUT_ROWS
        if feels:
            driving = driving or record[TOLD + s] != stages[stage, GOALS + s]
        elif state[row + k.REST] != state[row + k.TARGET]:
            driving = True
            record[DRIVEN + s] += 1
    if stages[stage, ENDS] == ON_TIME:
        _look_in_motion(state, record, rules, struts, stages)
        return
    if driving:
        record[QUIET] = record[WAITED] = 0
        return
    record[WAITED] += 1
    record[QUIET] = record[QUIET] + 1 if fastest < rules.rest_speed_m_s * rules.rest_speed_m_s else 0
    at_rest = record[QUIET] >= rules.hold_samples
    if not at_rest and record[WAITED] < rules.timeout_samples:
        return
    end_at_rest(state, record, rules, struts, stages, bits, face, margin, at_rest)


@njit(cache=True)
def _look_in_motion(state: Array, record: Array, rules: Rules, struts: int, stages: Array) -> None:
    """A sample of a stage that ends on time."""
    stage, face = int(record[STAGE]), -1
    onto, waits = stages[stage, ONTO], stages[stage, SEEN] >= 0
    if record[SAMPLES] % LOOK_SAMPLES == 0:
        joints, center = np.empty((12, 3)), np.empty(3)
        _where(state, rules, joints, center)
        face = under(joints, center, rules.down, rules.face_joints)
        _stood_on(record, face)
    if record[LANDED] > 0:
        record[LANDED] += 1
    if onto >= 0 and face >= 0 and face != onto and record[LANDED] == 0 and face != _before(record, stages, stage):
        record[PHASE] = MISSED
        return
    if face >= 0 and face == onto and record[LANDED] == 0:
        _reached(state, record, rules)
    if waits and record[LANDED] == 0 and record[ELAPSED] >= stages[stage, LIMIT]:
        record[PHASE] = MISSED
    elif record[ELAPSED] >= stages[stage, LEAST] and (not waits or record[LANDED] > stages[stage, SEEN]):
        if onto >= 0 and record[LANDED] == 0 and stage + 1 < stages.shape[0] and stages[stage + 1, ONTO] != onto:
            record[PHASE] = MISSED  # the next face cannot be reached over one that was not
            return
        _next(state, record, struts, stages)


@njit(cache=True)
def _before(record: Array, stages: Array, stage: int) -> int:
    """Number of the face that the stage begins on."""
    onto = stages[stage, ONTO]
    while stage > 0:
        stage -= 1
        if stages[stage, ONTO] != onto:
            return int(stages[stage, ONTO])
    return int(record[SOURCE])


@njit(cache=True)
def _reached(state: Array, record: Array, rules: Rules) -> None:
    """The robot stands on the stage's face for the first time."""
    center = np.empty(3)
    center_of_mass(state, rules.mass, center)
    record[LANDED] = 1
    record[REACHED] += 1
    place = FIRST_LANDING if record[REACHED] == 1 else LAST_LANDING
    record[place], record[place + 1], record[place + 2] = record[SAMPLES], center[0], center[1]


@njit(cache=True)
def end_at_rest(
    state: Array, record: Array, rules: Rules, struts: int, stages: Array, bits: int, face: int, margin: float, at_rest: bool
) -> None:
    """The robot has come to rest, or has not in time: keep its footing; go on to the next stage, or end."""
    stage = int(record[STAGE])
    place = ACTUATED if record[RESTS] == 0 else RETURNED
    record[RESTS] += 1
    record[place], record[place + 1], record[place + 2] = bits, face, margin
    record[QUIET] = record[WAITED] = 0
    if not at_rest:
        record[PHASE] = TIMED_OUT
        return
    if stages[stage, ONTO] < 0:
        for later in range(stage, stages.shape[0]):
            stages[later, ONTO] = face
    if face < 0 or face != stages[stage, ONTO] or (record[REACHED] == 0 and face == record[SOURCE]) or stage + 1 == stages.shape[0]:
        record[PHASE] = DONE
        return
    if record[LANDED] == 0:
        _reached(state, record, rules)
    _next(state, record, struts, stages)


@njit(cache=True)
def _next(state: Array, record: Array, struts: int, stages: Array) -> None:
    """The next stage begins; a landing counts for later stages that lead onto the same face."""
    stage = int(record[STAGE]) + 1
    if stage >= stages.shape[0]:
        record[PHASE] = DONE
        return
    if stages[stage, ONTO] != stages[stage - 1, ONTO]:
        record[LANDED] = 0
    record[STAGE] = stage
    record[ELAPSED] = record[QUIET] = record[WAITED] = 0
    for s in range(6):
        state[struts + s * k.STRUT_ROWS + k.TARGET] = stages[stage, GOALS + s]
