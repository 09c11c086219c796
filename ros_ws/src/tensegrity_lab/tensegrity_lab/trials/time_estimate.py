# SPDX-License-Identifier: Apache-2.0
"""How long a session takes: what the actuators' duty permits sets the pace. The same count of duty as the bridge's."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.limits import Limits
from tensegrity_lab.session_data.plan import Slot, next_due, placing

SETTLE_S = 5.0
"""Robot time from the end of a motion to the word that the robot rests."""


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


def runs_s(policy_mm: Sequence[int], speed_m_s: float) -> np.ndarray:
    """How long each strut runs in a trial, there and back (s of robot time). Shape (6,)."""
    return 2e-3 * np.abs(np.asarray(policy_mm, dtype=float)) / speed_m_s


def estimate(due: Sequence[Slot], face: str, pace: Pace) -> Estimate:
    """Walk through what is due, as the session would, with every trial a success.

    Args:
        due: the slots.
        face: where the robot is; empty: nowhere.
        pace: how long each part of a trial takes.
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
        needs_s = runs_s(slot.policy_mm, pace.speed_m_s)
        wait_s = min(duty.wait_s(needs_s, now_s, limits), limits.longest_window_s)
        rest_s, now_s = rest_s + wait_s, now_s + wait_s
        duty = duty.ran(needs_s.tolist(), now_s, limits)
        busy_s += needs_s
        now_s += float(needs_s.max()) + 2.0 * SETTLE_S + pace.hands_s * pace.time_scale
        left.remove(slot)
        face = slot.target
    scale = pace.time_scale
    return Estimate(len(due), placings, rest_s / scale, now_s / scale, float(busy_s.max()))
