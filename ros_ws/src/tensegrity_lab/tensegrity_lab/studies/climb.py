# SPDX-License-Identifier: Apache-2.0
"""How steep gaits climb: the virtual prototype's body alone, without ROS or bytes, sent uphill by one gait of each primitive."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.virtual_prototype.body import ActuatedBody, SimulatedBody
from sim_core.dynamics.actuators import ActuatorParameters
from sim_core.gaits.climb_limits import Climbs
from sim_core.gaits.library import Gait, Library, gait_of
from sim_core.structure.parameters import Prototype, load_prototype
from sim_core.structure.policy import in_stages, lengths_of, neutral_lengths

STEEPEST_DEG, NEAR_DEG = 16.0, 0.25
"""No gait is tried on steeper ground; how near the answer is."""
FRAME_S = 0.05
"""Between targets, as from the bridge."""
SETTLE_S, CALM_S = 3.0, 1.5
"""Longest wait for the target after actuation, and wait for rest, before the first move and after the return."""


class Climbed(NamedTuple):
    """How one roll ended: the face at rest after the return, and where the centre went on the floor, (2,)."""

    face: str | None
    shift_m: NDArray[np.float64]


def roll(
    prototype: Prototype, gait: Gait, actuators: ActuatorParameters | None, incline_deg: float, downhill_rad: float
) -> Climbed:
    """One roll of the nominal robot and its return, at constant speed. `actuators`: None: ideal ones."""
    if actuators is None:
        body = SimulatedBody(gait.source, 0.0, 0, None, incline_deg, downhill_rad)
    else:
        body = ActuatedBody(gait.source, 0.0, 0, actuators, incline_deg, downhill_rad)
    neutral_m = neutral_lengths(prototype)
    step_m = prototype.actuator_speed_m_s * FRAME_S

    def wait(seconds: float, until: str = "") -> None:
        end_s = body.time_s + seconds
        while body.time_s < end_s - 1e-6:
            body.advance_to(body.time_s + FRAME_S)
            seen = body.observe()
            if until and seen.settled and seen.face == until:
                return

    def drive(start_m: NDArray[np.float64], end_m: NDArray[np.float64]) -> None:
        frames = max(1, math.ceil(np.abs(end_m - start_m).max() / step_m - 1e-9))
        for frame in range(1, frames + 1):
            body.set_targets(start_m + np.clip(end_m - start_m, -frame * step_m, frame * step_m))
            body.advance_to(body.time_s + FRAME_S)

    body.set_targets(neutral_m)
    wait(CALM_S)
    before_m = body.observe().joints_m.mean(axis=0)[:2]
    moved_m = neutral_m
    for stage in in_stages(gait.policy):
        before_stage_m, moved_m = moved_m, lengths_of(prototype, stage)
        drive(before_stage_m, moved_m)
    wait(SETTLE_S, gait.target)
    drive(moved_m, neutral_m)
    wait(CALM_S)
    seen = body.observe()
    return Climbed(seen.face, seen.joints_m.mean(axis=0)[:2] - before_m)


def steepest_deg(prototype: Prototype, gait: Gait, actuators: ActuatorParameters | None) -> float:
    """The steepest ground on which the gait rolls straight uphill and stays, by bisection; 0: not even on level ground."""
    level = roll(prototype, gait, actuators, 0.0, 0.0)
    if level.face != gait.target:
        return 0.0
    downhill_rad = math.atan2(-level.shift_m[1], -level.shift_m[0])
    holds, fails = 0.0, STEEPEST_DEG
    while fails - holds > NEAR_DEG:
        middle = 0.5 * (holds + fails)
        if roll(prototype, gait, actuators, middle, downhill_rad).face == gait.target:
            holds = middle
        else:
            fails = middle
    return holds


def climbs_of(library: Library, actuators: ActuatorParameters | None, words: str, tell: Callable[[str], None]) -> Climbs:
    """Every primitive's reference gait. `words`: the actuators, for people. `tell`: told each primitive's name before it."""
    prototype = load_prototype()
    found = {}
    for primitive in library.primitives:
        tell(primitive.name)
        roll_class = primitive.roll_class
        found[primitive.name] = steepest_deg(prototype, gait_of(primitive, roll_class.source, roll_class.target), actuators)
    how = f"nominal robot, {words} actuators, straight uphill, by bisection to {NEAR_DEG:g} degrees"
    return Climbs(library.primitives_hash, how, found)
