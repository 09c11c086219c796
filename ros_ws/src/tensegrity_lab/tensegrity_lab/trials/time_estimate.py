# SPDX-License-Identifier: Apache-2.0
"""How long a session takes: what the actuators' duty permits sets the pace. The same count of duty as the bridge's."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.limits import Limits
from sim_core.gaits.library import Library
from sim_core.rolling.course import NEUTRAL
from sim_core.structure.policy import ways_mm
from tensegrity_lab.session_data.ledger_line import Line
from tensegrity_lab.session_data.plan import Slot, chain_in, next_due, placing

SETTLE_S = 5.0
"""Robot time from the end of a motion to the word that the robot rests."""
HELD = 1.2
"""Struts that are held under load run, too: by so much more than they move in a chain, as measured on virtual prototypes."""
MARGIN_S = 4.0
"""Running time that a chain leaves over beside that of two rolls and the way back, so that the planner does not end it early."""


class Pace(NamedTuple):
    """What takes how long.

    Attributes:
        speed_m_s: of an actuator.
        time_scale: robot seconds per second.
        hands_s: of wall time that a person, or the program, needs for each trial.
        placing_s: to put the robot on another face.
    """

    speed_m_s: float
    time_scale: float
    hands_s: float
    placing_s: float


HANDS = (4.0, 20.0)
"""A person's (hands_s, placing_s): a key, and lifting the robot."""
PROGRAM = (0.5, 3.0)
"""A virtual session's: finding out what comes next, and rolling to another face."""


class Estimate(NamedTuple):
    """A forecast in which every trial succeeds.

    Attributes:
        trials: to go.
        placings: how often the robot must be carried, or roll elsewhere.
        rest_s: wall time of resting for duty's sake.
        wall_s: all of it.
        busiest_s: robot time that the busiest strut runs.
    """

    trials: int
    placings: int
    rest_s: float
    wall_s: float
    busiest_s: float


class Work(NamedTuple):
    """What a trial asks of the actuators, in s of robot time.

    Attributes:
        runs_s: how long each strut runs, there and back, (6,).
        lasts_s: from the first move to the last.
        needs_s: how long every strut must be able to run before it begins.
    """

    runs_s: np.ndarray
    lasts_s: float
    needs_s: float


def work_of(gait: Slot | Line, library: Library, speed_m_s: float) -> Work:
    """What a gait or chain asks of the actuators. Raises SimError: the library does not have that chain."""
    if not gait.chain:
        runs_s = 1e-3 * np.array(ways_mm(gait.policy_mm)) / speed_m_s
        return Work(runs_s, float(runs_s.max()), float(runs_s.max()))
    rolls = chain_in(library, gait).rolls
    policies = np.array([NEUTRAL, *(roll.policy for roll in rolls), NEUTRAL], dtype=float)
    ways_s = 1e-3 * np.abs(np.diff(policies, axis=0)) / speed_m_s
    back_s, times_s = float(ways_s[-1].max()), np.array([roll.dwell_s + roll.time_s for roll in rolls])
    moves_s = np.minimum(ways_s[:-1], times_s[:, None]).sum(axis=0) + ways_s[-1]  # the next roll overtakes what is not there yet
    runs_s = HELD * moves_s
    two_s = float((times_s[:-1] + times_s[1:]).max())
    needs_s = float(runs_s.max()) + two_s + MARGIN_S
    return Work(runs_s, float(times_s.sum()) + back_s, min(needs_s, *(budget_s for _, budget_s in Limits().duty_windows)))


def estimate(due: Sequence[Slot], face: str, pace: Pace, library: Library) -> Estimate:
    """Walk through what is due, as the session would, with every trial a success.

    Args:
        due: the slots.
        face: where the robot is; empty: nowhere.
        pace: how long each part of a trial takes.
        library: of the plan.
    """
    left, duty, limits = list(due), Duty(), Limits()
    now_s = rest_s = 0.0
    placings, busy_s = 0, np.zeros(6)
    while left:
        slot = next_due(left, face)
        if slot is None:
            placings += 1
            now_s += pace.placing_s * pace.time_scale
            face = placing(left)
            continue
        work = work_of(slot, library, pace.speed_m_s)
        at_once_s = np.minimum(work.runs_s, limits.burst_fraction * limits.burst_window_s)  # a long chain has pauses of its own
        wait_s = min(duty.wait_s(at_once_s, now_s, limits), limits.longest_window_s)
        rest_s, now_s = rest_s + wait_s, now_s + wait_s
        duty = duty.ran(work.runs_s.tolist(), now_s, limits)
        busy_s += work.runs_s
        now_s += work.lasts_s + 2.0 * SETTLE_S + pace.hands_s * pace.time_scale
        left.remove(slot)
        face = slot.target
    scale = pace.time_scale
    return Estimate(len(due), placings, rest_s / scale, now_s / scale, float(busy_s.max()))
