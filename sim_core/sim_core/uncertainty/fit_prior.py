# SPDX-License-Identifier: Apache-2.0
"""What is thought of a robot before its trials: errors that the whole robot shares, on top of those of its single parts.

One rope more or less changes little; what decides whether *this* robot rolls is common to all its trials: the floor's friction and
slope, ropes of one batch (stiffness, rest length, hence prestress), and each strut's stroke. These are estimated. The errors of
single ropes and masses are noise (`perturbation_law.Law`): drawn anew for every member.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from sim_core.dynamics.model import Model, build_model
from sim_core.errors import ParameterError
from sim_core.structure.arrays import Array
from sim_core.uncertainty.perturbation_law import GROUPS, Law, errors_of

NOISE_GROUPS = ("stiffness", "rest_length", "mass")
DIMENSIONS = 11
"""Friction, stiffness, rest length, six strokes, two slopes."""
LABELS = (
    "friction factor",
    "stiffness factor",
    "rest length factor",
    *(f"stroke factor S{s}" for s in range(1, 7)),
    "slope about x (deg)",
    "slope about y (deg)",
)
LIMITS = {"friction": 0.9, "stiffness": 0.3, "rest_length": 0.1, "stroke": 0.3, "slope_deg": 15.0}
HEADING_STREAM = 26
"""Sets the headings apart from other uses of the same seed."""


class Member(NamedTuple):
    """One member of an ensemble: everything that makes it another robot than the drawing.

    Attributes:
        friction, stiffness, rest_length: factors of both coefficients, of all ropes' stiffness, of all ropes' rest lengths.
        stroke: six factors.
        slope_deg: tilt of the ground about x, then y, in degrees, for the robot placed as the model places it.
        noise: scale of the errors of single members.
        seed, number: which draw of these.
    """

    friction: float
    stiffness: float
    rest_length: float
    stroke: tuple[float, float, float, float, float, float]
    slope_deg: tuple[float, float]
    noise: float
    seed: int
    number: int

    @property
    def parameters(self) -> tuple[float, ...]:
        """In the order of LABELS."""
        return self.friction, self.stiffness, self.rest_length, *self.stroke, *self.slope_deg

    def turned(self, angle: float) -> Member:
        """The same robot put on the floor turned by `angle` (rad): downhill is another way."""
        c, s, (x, y) = math.cos(angle), math.sin(angle), self.slope_deg
        return self._replace(slope_deg=(c * x - s * y, s * x + c * y))

    @property
    def steepness_deg(self) -> float:
        """How much the ground is inclined."""
        return math.hypot(*self.slope_deg)


@dataclass(frozen=True)
class Prior:
    """What is thought of a robot before its trials: independent and uniform, each factor in 1 ± its number.

    Attributes:
        friction, stiffness, rest_length, stroke: half ranges of factors.
        slope_deg: of the ground's tilt about each axis.
        noise: scale of `perturbation_law.Law` for the errors of single ropes and masses.
    """

    friction: float = 0.6
    stiffness: float = 0.2
    rest_length: float = 0.03
    stroke: float = 0.1
    slope_deg: float = 5.0
    noise: float = 0.1

    def __post_init__(self) -> None:
        for name, most in LIMITS.items():
            if not 0.0 <= getattr(self, name) <= most:
                raise ParameterError(f"prior of {name} ± {getattr(self, name)!r}: valid is a number in [0, {most}]")
        Law(self.noise)  # raises

    @property
    def text(self) -> str:
        """The prior, for people and for provenance."""
        return (
            f"uniform: friction ±{100 * self.friction:g} %, all ropes' stiffness ±{100 * self.stiffness:g} %, all ropes' rest "
            f"length ±{100 * self.rest_length:g} %, each strut's stroke ±{100 * self.stroke:g} %, ground tilted by "
            f"±{self.slope_deg:g} degrees about each axis; besides, single ropes and masses at scale s = {self.noise:g}"
        )

    def member(self, z: Array, seed: int, number: int) -> Member:
        """The robot at normal scores z, (DIMENSIONS,); the errors of its single members are draw `number` of `seed`."""
        u = 2.0 * ndtr(z) - 1.0
        f, k, r, *strokes = (1.0 + u[:9] * ([self.friction, self.stiffness, self.rest_length] + 6 * [self.stroke])).tolist()
        slope = self.slope_deg * u[9:]
        return Member(f, k, r, tuple(strokes), (float(slope[0]), float(slope[1])), self.noise, seed, number)


def member_model(nominal: Model, member: Member) -> Model:
    """Build a member.

    Raises:
        ParameterError, ModelError: it cannot be built.
    """
    e = nominal.elements
    law = Law(member.noise, NOISE_GROUPS)
    for name, errors in errors_of(nominal, law, member.seed, [member.number]).items():
        if name in law.groups:
            e = GROUPS[name].apply(e, errors[0])
    e = replace(
        e,
        friction=e.friction * member.friction,
        cable_stiffness_n_m=e.cable_stiffness_n_m * member.stiffness,
        cable_rest_m=e.cable_rest_m * member.rest_length,
        strut_gain=e.strut_gain * np.array(member.stroke),
    )
    return build_model(nominal.prototype, GROUPS["slope"].apply(e, np.radians(member.slope_deg)))


def headings(seed: int, number: int, count: int) -> Array:
    """Directions (rad) in which robot `number` stood at each of `count` trials, if nobody knows: uniform, (count,)."""
    return np.asarray(np.random.default_rng([seed, number, HEADING_STREAM]).uniform(0.0, 2.0 * math.pi, count))
