# SPDX-License-Identifier: Apache-2.0
"""Courses: several rolls in a row without a stop, as stages, and their judgement."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.footing import FACE_NAMES
from sim_core.dynamics.model import Model
from sim_core.gaits.cycle import ChainRoll
from sim_core.rolling import roll_monitor as w
from sim_core.rolling.roll_monitor import SAMPLE_S
from sim_core.structure.arrays import Array
from sim_core.structure.policy import Policy, in_stages, lengths_of

NEUTRAL: Policy = (0, 0, 0, 0, 0, 0)
LATENCY_S = 0.4
"""From a landing to the first frame of the next motion: an observer's word, its way, the judging of shapes, the bridge's lead."""
LIMIT_S = 12.0
"""A robot that has not landed so long after a stage's beginning has missed: twice the longest stroke at the actuators' speed."""


class Stage(NamedTuple):
    """Lengths to drive to, and when to go on.

    Attributes:
        policy: six strokes, whole mm.
        onto: the face that it leads onto; empty: whatever is stood on meanwhile.
        least_s: it lasts so long at least, from its beginning; None: until the robot is at rest.
        seen_s: and so long after the robot first stood on the face; None: whether it stands there or not.
        limit_s: a robot that does not stand there so long after the beginning has missed.
    """

    policy: Policy
    onto: str
    least_s: float | None = None
    seen_s: float | None = None
    limit_s: float = 0.0


class Course(NamedTuple):
    """Stages for one robot: which model (index), from which face at rest."""

    model: int
    source: str
    stages: tuple[Stage, ...]


@dataclass(frozen=True)
class CourseResult:
    """What a course did.

    Attributes:
        target: the last face of the course.
        reached: how many faces of the course, in its order.
        wanted: how many it has.
        feasible: all of them, at rest at the end, with clearance and strut force as a roll needs them.
        reason: why not, in one line; empty if feasible.
        faces: every face stood on, in order, from the first.
        ended: the face at rest at the end; empty: none, or it did not come to rest.
        peak_force_n, clearance_m, travel_m: as of a roll.
        duration_s: simulated time.
        driven_s: how long each strut was driven, (6,).
        between_s: from the first landing to the last.
        pace_m_s: straight way of the centre of mass in that time / time; 0 with less than two landings.
    """

    target: str
    reached: int
    wanted: int
    feasible: bool
    reason: str
    faces: tuple[str, ...]
    ended: str
    peak_force_n: float
    clearance_m: float
    duration_s: float
    driven_s: tuple[float, ...]
    travel_m: tuple[float, float]
    between_s: float
    pace_m_s: float


def table_of(model: Model, stages: Sequence[Stage]) -> Array:
    """The monitor's rows, (n, STAGE_ROWS)."""
    rows = np.zeros((len(stages), w.STAGE_ROWS))
    for row, stage in zip(rows, stages, strict=True):
        row[: w.ONTO] = model.rest_lengths(lengths_of(model.prototype, stage.policy))
        row[w.ONTO] = FACE_NAMES.index(stage.onto) if stage.onto else -1
        row[w.SEEN] = -1
        if stage.least_s is not None:
            row[w.ENDS], row[w.LEAST] = w.ON_TIME, _samples(stage.least_s)
            if stage.seen_s is not None:
                row[w.SEEN], row[w.LIMIT] = _samples(stage.seen_s), _samples(stage.limit_s)
    return rows


def _samples(seconds: float) -> int:
    return math.ceil(seconds / SAMPLE_S - 1e-9)


def wanted_of(stages: Sequence[Stage]) -> int:
    """How many faces a course leads over."""
    faces = [stage.onto for stage in stages if stage.onto]
    return sum(1 for before, face in zip(("", *faces), faces, strict=False) if before != face)


def course_result_of(
    model: Model, stages: Sequence[Stage], record: Array, peak_forces_n: Array, center_of_mass_m: Array
) -> CourseResult:
    """Judge a finished record."""
    rule, phase = model.prototype, int(record[w.PHASE])
    peak, clearance = float(peak_forces_n.max()), float(record[w.CLEARANCE])
    allowed = rule.force_fraction * rule.actuator_stall_n
    faces = tuple(FACE_NAMES[int(n)] for n in record[w.FACE_LIST : w.FACE_LIST + int(record[w.FACES_SEEN])])
    stage = stages[int(record[w.STAGE])]
    stood = int(record[(w.ACTUATED if record[w.RESTS] < 2 else w.RETURNED) + 1])
    if phase == w.DIVERGED:
        reason = "the simulation diverged"
    elif phase == w.MISSED:
        reason = f"on the way to {stage.onto} it came to {faces[-1]}"
    elif phase == w.TIMED_OUT:
        reason = f"not settled within {rule.rest_timeout_s:g} s at the end"
    elif stages[-1].least_s is None and (stood < 0 or FACE_NAMES[stood] != stages[-1].onto):
        reason = f"at the end it stood on {FACE_NAMES[stood] if stood >= 0 else 'no face'}"
    elif peak > allowed:
        reason = f"strut force reached {peak:.1f} N; allowed are {allowed:.1f} N"
    elif clearance < rule.clearance_margin_m:
        reason = f"clearance fell to {1e3 * clearance:.1f} mm; required are {1e3 * rule.clearance_margin_m:.1f} mm"
    else:
        reason = ""
    travel = center_of_mass_m - record[w.START : w.START + 3]
    first, last = (record[place : place + 3] for place in (w.FIRST_LANDING, w.LAST_LANDING))
    between_s = float(last[0] - first[0]) * SAMPLE_S
    return CourseResult(
        stages[-1].onto,
        int(record[w.REACHED]),
        wanted_of(stages),
        not reason,
        reason,
        faces,
        FACE_NAMES[stood] if stood >= 0 else "",
        peak,
        clearance,
        float(record[w.SAMPLES]) * SAMPLE_S,
        tuple(float(samples) * SAMPLE_S for samples in record[w.DRIVEN : w.DRIVEN + 6]),
        (float(travel[0]), float(travel[1])),
        max(0.0, between_s),
        float(np.hypot(*(last[1:] - first[1:]))) / between_s if between_s > 0.0 else 0.0,
    )


def stages_of_chain(rolls: Sequence[ChainRoll], latency_s: float = LATENCY_S, observed: bool = True) -> tuple[Stage, ...]:
    """A chain's stages, and then neutral until at rest.

    Args:
        rolls: of the chain.
        latency_s: from the landing to the next frame, beside a stage's own dwelling.
        observed: each roll waits for the face; else for its own time.
    """
    stages = [
        Stage(roll.policy, roll.onto, 0.0, latency_s + roll.dwell_s, LIMIT_S)
        if observed
        else Stage(roll.policy, roll.onto, roll.time_s)
        for roll in rolls
    ]
    return (*stages, Stage(NEUTRAL, rolls[-1].onto))


def stages_of_rolls(policies: Sequence[Policy], onto: Sequence[str], speed_m_s: float) -> tuple[Stage, ...]:
    """The stages of rolls one after the other as `roll` makes each: at rest after actuation, and at rest in neutral.

    `speed_m_s`: of the actuators; so long they have for the first stage of a policy in two.
    """
    stages: list[Stage] = []
    for policy, face in zip(policies, onto, strict=True):
        *via, last = in_stages(policy)
        stages += [Stage(part, "", 1e-3 * max(map(abs, part)) / speed_m_s) for part in via]
        stages += [Stage(last, face), Stage(NEUTRAL, face)]
    return tuple(stages)
