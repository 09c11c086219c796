"""A roll and its judgement: actuate, wait until at rest, return to neutral, wait until at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_core.elements import Array
from sim_core.footing import Footing
from sim_core.model import Model
from sim_core.policy import Policy, checked_policy, lengths_of, neutral_lengths
from sim_core.robot import Robot
from sim_core.structure import require_adjacent

SAMPLE_S = 0.01
"""Footing, clearance and rest are looked at this often. Strut forces are watched at every step."""


@dataclass(frozen=True)
class RollResult:
    """What a roll did.

    Attributes:
        source, target: faces asked for.
        policy: strokes in mm.
        feasible: judged as in docs/model.md "What a roll is".
        reason: why not, in one line; empty if feasible.
        faces: every face stood on, in order, from the first.
        actuated, returned: footing at rest after actuation and after the return (returned: None if not reached).
        peak_force_n: largest strut force along the path. clearance_m: smallest gap between surfaces along the path.
        margin_m: smaller of the two margins of the centre of mass inside the base triangle at rest.
        duration_s: simulated time. travel_m: (x, y) displacement of the centre of mass.
    """

    source: str
    target: str
    policy: Policy
    feasible: bool
    reason: str
    faces: tuple[str, ...]
    actuated: Footing
    returned: Footing | None
    peak_force_n: float
    clearance_m: float
    margin_m: float
    duration_s: float
    travel_m: tuple[float, float]


class _Watch:
    """Steps a robot and keeps what the judgement needs."""

    def __init__(self, robot: Robot, trace: list[Sample] | None):
        self.robot, self.trace = robot, trace
        self.chunk = max(1, round(SAMPLE_S * robot.model.steps_per_second))
        self.clearance_m = robot.clearance_m()
        self.faces = [face] if (face := robot.footing().face) else []
        robot.reset_peaks()

    def until_rest(self) -> bool:
        """Step until the actuators have stopped and every joint has been slow for the hold time; False on time-out."""
        robot, rule = self.robot, self.robot.model.prototype
        chunk_s = self.chunk * robot.model.dt_s
        quiet_s, waited_s = 0.0, 0.0
        while waited_s < rule.rest_timeout_s:
            robot.advance(self.chunk)
            self._look()
            driving = not np.array_equal(robot.rest_lengths_m(), robot.targets_m())
            waited_s = 0.0 if driving else waited_s + chunk_s
            quiet_s = quiet_s + chunk_s if robot.is_slow() and not driving else 0.0
            if quiet_s >= rule.rest_hold_s:
                return True
        return False

    def _look(self) -> None:
        self.clearance_m = min(self.clearance_m, self.robot.clearance_m())
        face = self.robot.footing().face
        if face and (not self.faces or self.faces[-1] != face):
            self.faces.append(face)
        if self.trace is not None:
            self.trace.append(sample(self.robot))


@dataclass(frozen=True)
class Sample:
    """One moment of a recorded roll: time (s), joints (12, 3) m, box (3,) m, rest lengths (6,) m, strut forces (6,) N, face."""

    time_s: float
    joints_m: Array
    box_m: Array
    lengths_m: Array
    forces_n: Array
    face: str | None


def sample(robot: Robot) -> Sample:
    """The robot now."""
    return Sample(
        robot.step * robot.model.dt_s,
        robot.joints_m(),
        robot.box_m(),
        robot.rest_lengths_m(),
        robot.strut_forces_n(),
        robot.footing().face,
    )


def roll(
    model: Model,
    source: str,
    target: str,
    policy: Sequence[float],
    *,
    start: Robot | None = None,
    trace: list[Sample] | None = None,
) -> RollResult:
    """Roll from `source` with a policy and judge whether it lands, and stays, on `target`.

    Args:
        policy: six strokes, whole mm, for this very pair (not for the reference pair).
        start: a robot resting on `source` at neutral lengths (changed in place); default: settled afresh.
        trace: filled with samples every 10 ms if given.

    Raises:
        UnknownFaceError, NotAdjacentError, PolicyError, DivergedError.
    """
    require_adjacent(source, target)
    checked = checked_policy(policy, model.prototype.policy_limit_mm)
    robot = start if start is not None else Robot.resting_on(model, source)
    return follow_policy(robot, source, target, checked, trace)


def follow_policy(robot: Robot, source: str, target: str | None, policy: Policy, trace: list[Sample] | None = None) -> RollResult:
    """`roll` without its checks; with target None the roll is judged against the face it lands on."""
    model = robot.model
    began, start_m = robot.step, robot.center_of_mass_m()
    watch = _Watch(robot, trace)
    robot.set_targets(lengths_of(model.prototype, policy))
    at_rest = watch.until_rest()
    actuated = robot.footing()
    aim = target if target is not None else (actuated.face or "")
    reason, returned = "", None
    if not at_rest:
        reason = f"not settled within {model.prototype.rest_timeout_s:g} s after actuation"
    elif actuated.face != aim or aim == source:
        reason = f"after actuation it {_stands(actuated)}"
    else:
        robot.set_targets(neutral_lengths(model.prototype))
        at_rest = watch.until_rest()
        returned = robot.footing()
        if not at_rest:
            reason = f"not settled within {model.prototype.rest_timeout_s:g} s after the return"
        elif returned.face != aim:
            reason = f"after the return it {_stands(returned)}"
    peak = float(robot.peak_forces_n().max())
    allowed = model.prototype.force_fraction * model.prototype.actuator_stall_n
    if not reason and peak > allowed:
        reason = f"strut force reached {peak:.1f} N; allowed are {allowed:.1f} N"
    if not reason and watch.clearance_m < model.prototype.clearance_margin_m:
        reason = (
            f"clearance fell to {1e3 * watch.clearance_m:.1f} mm; required are {1e3 * model.prototype.clearance_margin_m:.1f} mm"
        )
    travel = robot.center_of_mass_m() - start_m
    return RollResult(
        source,
        aim,
        policy,
        not reason,
        reason,
        tuple(watch.faces),
        actuated,
        returned,
        peak,
        watch.clearance_m,
        float(np.min([actuated.margin_m, returned.margin_m if returned else actuated.margin_m])),
        (robot.step - began) * model.dt_s,
        (float(travel[0]), float(travel[1])),
    )


def _stands(footing: Footing) -> str:
    return f"stood on {footing.face}" if footing.face else footing.detail
