# SPDX-License-Identifier: Apache-2.0
"""Where the floor is, seen from the box, and how well each of the twenty faces fits: the measurement part of a Bayes filter.

Directions are kept in the box's frame: down, the floor's normal (into the floor), which is down as long as nobody knows how the
ground leans, and some direction ahead. Rates of turn carry all along; accelerations pull them towards gravity where they are about
gravity. Each face has such a normal too, from the twin's shape at the present strut lengths: on the face that the robot stands on,
it agrees with the floor's. Once a face is sure at rest, the floor's normal is that face's, and so the slope is known; after that
only the shape's errors count.

These errors (of shape, mounting and slope) stay the same as long as the robot rests. So measurements are averaged, and their
likelihood counts once, not again with every sample.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.model import Model
from sim_core.structure.arrays import Array
from sim_core.structure.rotations import matrix_of
from sim_core.structure.topology import FACES

GRAVITY_M_S2 = 9.80665
NAMES = tuple(FACES)
NONE = len(NAMES)
"""Index of "on none" among the probabilities."""

# rows of the state
DOWN, FLOOR, FELT, AHEAD, BIAS, QUIET_S, SLOPE_KNOWN, APART_S, STILL_S = 0, 3, 6, 9, 12, 15, 16, 17, 18
ROWS = 19

BESIDE = np.array([[i for i, a in enumerate(FACES.values()) if len(set(a) & set(b)) == 2] for b in FACES.values()])
"""Of each face, the three that share an edge with it, of tendons or none: (20, 3)."""
BEYOND = tuple(tuple({int(far) for near in BESIDE[i] for far in BESIDE[near]} - {i, *map(int, BESIDE[i])}) for i in range(NONE))
"""Of each face, those beside the ones beside it: a robot that tumbles may pass over one too fast for its being told."""


class FilterRules(NamedTuple):
    """Numbers of the filter, hand-chosen.

    Attributes:
        known_rad: scatter of a face's normal about the floor's, where the slope is known: errors of shape and mounting.
        unknown_rad: likewise where it is not known: slopes up to 10° beside that.
        center_m: scatter of the centre of mass over a face.
        smooth_s: time over which accelerations are averaged.
        pull_s: time in which accelerations pull the directions.
        loud: accelerations that differ from gravity by more than this part of it do not.
        quiet_rad_s: slower is at rest.
        apart_rad: rates and accelerations that disagree by more about down do not belong together, such as of a sensor that slips.
        bias_s: the bias of the rates is their mean at rest, over so much time.
        most_bias_rad_s: of that bias.
    """

    known_rad: float = math.radians(2.0)
    unknown_rad: float = math.radians(6.5)
    center_m: float = 0.0045
    smooth_s: float = 0.1
    pull_s: float = 0.4
    loud: float = 0.1
    quiet_rad_s: float = math.radians(3.0)
    apart_rad: float = 0.2
    bias_s: float = 10.0
    most_bias_rad_s: float = math.radians(2.0)


class Shape(NamedTuple):
    """A shape in the box's frame.

    Attributes:
        corners_m: of each face, counterclockwise seen along its normal, from the centre of mass: (20, 3, 3).
        normals: of each face, its direction into the floor, were the robot on it: (20, 3).
    """

    corners_m: Array
    normals: Array


def shape_of(joints_m: Array, box_m: Array, box_quaternion: Array, box_share: float) -> Shape:
    """A shape in any attitude, seen from its box.

    Args:
        joints_m: (12, 3).
        box_m: (3,).
        box_quaternion: of the box, (w, x, y, z).
        box_share: of the whole mass; the rest is spread evenly over struts and joints.
    """
    middle = joints_m.mean(axis=0)
    center = (1.0 - box_share) * middle + box_share * box_m
    corners = joints_m[np.array([FACES[name] for name in NAMES])] - center
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, corners[:, 0] - (middle - center)) < 0.0
    corners[inward] = corners[inward][:, ::-1]
    normals[inward] *= -1.0
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    turn = matrix_of(box_quaternion)
    return Shape(np.ascontiguousarray(corners @ turn), np.ascontiguousarray(normals @ turn))


def box_share(model: Model) -> float:
    """Of the box in the robot's mass."""
    return model.prototype.box_mass_kg / math.fsum(model.elements.mass_kg)


def new_state(acceleration: Array) -> Array:
    """Before the second measurement: down as the first acceleration, (3,), has it."""
    state = np.zeros(ROWS)
    down = -acceleration / max(1e-9, float(np.linalg.norm(acceleration)))
    for row in (DOWN, FLOOR, FELT):
        state[row : row + 3] = down
    state[AHEAD + int(np.argmin(np.abs(down)))] = 1.0
    return state


@njit(cache=True)
def track(state: Array, dt_s: float, rate_rad_s: Array, acceleration_m_s2: Array, still: bool, rules: FilterRules) -> None:
    """One measurement.

    Args:
        state: (ROWS,), changed.
        dt_s: since the one before.
        rate_rad_s: of turn, in the box's frame, (3,).
        acceleration_m_s2: likewise, as sensors tell it: upward at rest.
        still: no strut is driven.
        rules: see there.
    """
    rate = rate_rad_s - state[BIAS : BIAS + 3]
    _turn(state, rate, -dt_s)
    felt = state[FELT : FELT + 3]  # a box that swings after a landing shakes about down
    felt += min(1.0, dt_s / rules.smooth_s) * (-acceleration_m_s2 / GRAVITY_M_S2 - felt)
    size = math.sqrt((felt**2).sum())
    loud = abs(size - 1.0)
    if loud < rules.loud:
        # the smallest turn from down towards what is felt, a part of it
        agrees = (state[DOWN : DOWN + 3] * felt).sum() > size * math.cos(rules.apart_rad)
        state[APART_S] = 0.0 if agrees else state[APART_S] + dt_s
        _turn(state, np.cross(state[DOWN : DOWN + 3], felt) / size, min(1.0, dt_s / rules.pull_s))
    if math.sqrt((rate**2).sum()) < rules.quiet_rad_s and loud < rules.loud:
        state[QUIET_S] += dt_s
        if still and state[QUIET_S] > 0.5:
            bias = state[BIAS : BIAS + 3]
            state[STILL_S] += dt_s
            bias += rate * dt_s / min(state[STILL_S], rules.bias_s)
            over = math.sqrt((bias**2).sum()) / rules.most_bias_rad_s
            if over > 1.0:
                bias /= over
    else:
        state[QUIET_S] = 0.0


@njit(cache=True)
def _turn(state: Array, axis: Array, angle: float) -> None:
    """All directions, about an axis whose length scales the angle; small angles."""
    for row in (DOWN, FLOOR, FELT, AHEAD):
        direction = state[row : row + 3]
        size = math.sqrt((direction**2).sum())
        direction += angle * np.cross(axis, direction)
        direction *= size / max(1e-9, math.sqrt((direction**2).sum()))


@njit(cache=True)
def likelihoods(state: Array, corners_m: Array, normals: Array, rules: FilterRules) -> Array:
    """Of what is measured, on each face and on none of them, (21,): densities per steradian, a normal law and an even one.

    Where struts have made two faces nearly one plane, only the centre of mass tells on which of them the robot stands: a face that
    it is not above is as much less likely as the shape's errors permit.
    """
    known = state[SLOPE_KNOWN] > 0.0
    scatter, row = (rules.known_rad, FLOOR) if known else (rules.unknown_rad, DOWN)
    found = np.full(NONE + 1, 0.25 / math.pi)
    for face in range(NONE):
        cosine = normals[face, 0] * state[row] + normals[face, 1] * state[row + 1] + normals[face, 2] * state[row + 2]
        found[face] = math.exp(-(1.0 - min(1.0, cosine)) / scatter**2) / (2.0 * math.pi * scatter**2)
        if found[face] > 1e-6:
            inside = inside_m(corners_m[face], normals[face], state[DOWN : DOWN + 3]) / rules.center_m
            found[face] *= max(1e-3, 0.5 * math.erfc(-inside / math.sqrt(2.0)))
    return found


@njit(cache=True)
def inside_m(corners: Array, normal: Array, down: Array) -> float:
    """How far inside a triangle the origin is, projected along `down`, from the nearest edge; negative: outside."""
    along = (normal * down).sum()
    if along < 0.1:
        return -1.0
    foot = (normal * corners[0]).sum() / along * down
    least = np.inf
    for i in range(3):
        edge = corners[(i + 1) % 3] - corners[i]
        least = min(least, (np.cross(edge, foot - corners[i]) * normal).sum() / math.sqrt((edge**2).sum()))
    return least


def anchor(state: Array, normals: Array, face: int, part: float = 1.0) -> None:
    """The robot is on this face for sure: the floor's normal is the face's, so the slope is known from now on.

    `part`: of the way there. A shape that struts change slowly is off by little more on the next face than on this one, which it
    shares an edge with: so the error is taken away with the shape, and what is left counts when the robot tips.
    """
    floor = state[FLOOR : FLOOR + 3]
    floor += part * (normals[face] - floor)
    floor /= np.linalg.norm(floor)
    state[SLOPE_KNOWN] = 1.0


def forget_slope(state: Array) -> None:
    """The floor's normal is down, as far as anybody knows."""
    state[FLOOR : FLOOR + 3] = state[DOWN : DOWN + 3]
    state[SLOPE_KNOWN] = 0.0


def residual_rad(state: Array, normals: Array, face: int) -> float:
    """Angle between the face's normal and the floor's, or down, if the slope is not known."""
    row = FLOOR if state[SLOPE_KNOWN] > 0.0 else DOWN
    return math.acos(min(1.0, max(-1.0, float(normals[face] @ state[row : row + 3]))))
