# SPDX-License-Identifier: Apache-2.0
"""On which face the robot stands, and how near its parts are to each other."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.jit_cache import njit
from sim_core.structure.arrays import Array
from sim_core.structure.topology import FACES, STRUTS

STRUT_ENDS = np.array(STRUTS, dtype=np.int32)
"""(6, 2) node indices."""
FACE_NAMES: tuple[str, ...] = tuple(FACES)
"""Face number -> name."""


def _face_table() -> NDArray[np.int8]:
    table = np.full(1 << 12, -1, dtype=np.int8)
    for number, nodes in enumerate(FACES.values()):
        table[sum(1 << node for node in nodes)] = number
    table.setflags(write=False)
    return table


FACE_OF_JOINTS = _face_table()
"""(4096,) bit mask of joints -> face number, −1 if those joints are no face."""
FACE_JOINTS = np.array(list(FACES.values()), dtype=np.int64)
"""(20, 3) joints of each face; edge i of a face goes from joint i to joint i + 1."""


class Footing(NamedTuple):
    """What the robot stands on.

    Attributes:
        face: the base face, or None if it stands on none.
        detail: for people: the face, or why there is none.
        joints: indices of the joints that carry weight.
        margin_m: distance of the centre of mass's projection from the nearest edge of the three joints' triangle, negative outside;
            NaN unless exactly three joints carry.
    """

    face: str | None
    detail: str
    joints: tuple[int, ...]
    margin_m: float


@njit(cache=True)
def center_of_mass(state: Array, mass: Array, out: Array) -> None:
    """Write the centre of mass into `out` (3,)."""
    total = 0.0
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    for p in range(mass.shape[0]):
        total += mass[p]
        for axis in range(3):
            out[axis] += mass[p] * state[p * k.PARTICLE_ROWS + k.X + axis]
    for axis in range(3):
        out[axis] /= total


@njit(cache=True)
def base(
    joints: Array, center: Array, ground_force: Array, carry: float, down: Array, face_of_joints: NDArray[np.int8]
) -> tuple[int, int, float]:
    """Bit mask of the joints that carry, the base face's number (−1: none), and the margin (NaN unless three carry)."""
    bits, count = 0, 0
    corner = np.empty(3, np.int64)
    for joint in range(12):
        if ground_force[joint] > carry:
            bits |= 1 << joint
            if count < 3:
                corner[count] = joint
            count += 1
    if count != 3:
        return bits, -1, np.nan
    # the centre of mass, projected along gravity
    x = center[0] - down[0] * center[2] / down[2]
    y = center[1] - down[1] * center[2] / down[2]
    ax, ay = joints[corner[0], 0], joints[corner[0], 1]
    bx, by = joints[corner[1], 0], joints[corner[1], 1]
    cx, cy = joints[corner[2], 0], joints[corner[2], 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    sign = 1.0 if area > 0.0 else -1.0
    margin = min(
        sign * _off_line(ax, ay, bx, by, x, y),
        sign * _off_line(bx, by, cx, cy, x, y),
        sign * _off_line(cx, cy, ax, ay, x, y),
    )
    face = int(face_of_joints[bits]) if margin >= 0.0 else -1
    return bits, face, margin


LOW_M = 0.01
"""A joint that is no higher above the lowest one is as good as on the ground for a robot in motion."""


@njit(cache=True)
def under(joints: Array, center: Array, down: Array, face_joints: NDArray[np.int64]) -> int:
    """Number of the face that a robot in motion stands on, −1: none: all its joints are low, and the centre of mass is over it.

    Whatever carries: a moving robot bounces, and in many a shape a fourth joint touches the ground. At rest only `base` counts.
    """
    lowest, inside = np.inf, np.empty(3)
    for joint in range(12):
        lowest = min(lowest, joints[joint, 2])
    for face in range(face_joints.shape[0]):
        corners, high = face_joints[face], 0.0
        for corner in range(3):
            high = max(high, joints[corners[corner], 2] - lowest)
        if high > LOW_M:
            continue
        inside[:] = -np.inf
        past_edges(joints, center, down, corners, inside)
        if inside.max() <= 0.0:
            return face
    return -1


@njit(cache=True)
def past_edges(joints: Array, center: Array, down: Array, corners: NDArray[np.int64], most: Array) -> None:
    """Raise `most` (3,): how far the centre of mass, projected along gravity, is outside each edge of a triangle.

    `corners` are the triangle's joints; negative: inside.
    """
    x = center[0] - down[0] * center[2] / down[2]
    y = center[1] - down[1] * center[2] / down[2]
    a, b, c = joints[corners[0]], joints[corners[1]], joints[corners[2]]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    sign = -1.0 if area > 0.0 else 1.0
    most[0] = max(most[0], sign * _off_line(a[0], a[1], b[0], b[1], x, y))
    most[1] = max(most[1], sign * _off_line(b[0], b[1], c[0], c[1], x, y))
    most[2] = max(most[2], sign * _off_line(c[0], c[1], a[0], a[1], x, y))


@njit(cache=True)
def _off_line(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Signed distance of a point from the line a → b, positive on its left."""
    ex, ey = bx - ax, by - ay
    return (ex * (y - ay) - ey * (x - ax)) / float(np.sqrt(ex * ex + ey * ey))


def footing_of(bits: int, face: int, margin_m: float) -> Footing:
    """What `base` found, for people."""
    carrying = tuple(joint for joint in range(12) if bits >> joint & 1)
    names = ", ".join(str(joint + 1) for joint in carrying)
    if len(carrying) != 3:
        detail = f"rests on {len(carrying)} joints ({names})" if carrying else "does not touch the ground"
    elif face >= 0:
        detail = FACE_NAMES[face]
    elif FACE_OF_JOINTS[bits] < 0:
        detail = f"rests on joints {names}, which are no face"
    else:
        detail = f"rests on {FACE_NAMES[FACE_OF_JOINTS[bits]]} with the centre of mass outside it"
    return Footing(FACE_NAMES[face] if face >= 0 else None, detail, carrying, float(margin_m))


def judge_footing(joints_m: Array, center_of_mass_m: Array, ground_force_n: Array, carry_n: float, down: Array) -> Footing:
    """The base face: the three joints that carry the weight, with the centre of mass's projection inside their triangle.

    Args:
        joints_m: (12, 3).
        center_of_mass_m: (3,).
        ground_force_n: (12,) normal force per joint.
        carry_n: a joint that carries more than this touches the ground.
        down: (3,) direction of gravity.
    """
    return footing_of(*base(joints_m, center_of_mass_m, ground_force_n, carry_n, down, FACE_OF_JOINTS))


@njit(cache=True)
def _segment_gap(p: Array, d1: Array, q: Array, d2: Array) -> float:
    """Distance between segments p + s d1 and q + t d2, s and t in [0, 1] (closest points, clamped)."""
    a = d1[0] * d1[0] + d1[1] * d1[1] + d1[2] * d1[2]
    e = d2[0] * d2[0] + d2[1] * d2[1] + d2[2] * d2[2]
    rx, ry, rz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    f = d2[0] * rx + d2[1] * ry + d2[2] * rz
    c = d1[0] * rx + d1[1] * ry + d1[2] * rz
    b = d1[0] * d2[0] + d1[1] * d2[1] + d1[2] * d2[2]
    denominator = a * e - b * b
    s = min(max((b * f - c * e) / denominator, 0.0), 1.0) if denominator > 1e-12 * a * e else 0.0
    t = (b * s + f) / e
    if t < 0.0:
        t, s = 0.0, min(max(-c / a, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((b - c) / a, 0.0), 1.0)
    gx, gy, gz = rx + s * d1[0] - t * d2[0], ry + s * d1[1] - t * d2[1], rz + s * d1[2] - t * d2[2]
    return float(np.sqrt(gx * gx + gy * gy + gz * gz))


@njit(cache=True)
def clearance(joints: Array, box: Array, ends: NDArray[np.int32], strut_diameter: float, box_radius: float) -> float:
    """Smallest gap between surfaces of two struts, or of a strut and the box (a sphere). Struts are straight cylinders."""
    between, to_box = np.inf, np.inf
    axes = np.empty((6, 3))
    for i in range(6):
        along, square = 0.0, 0.0
        for axis in range(3):
            axes[i, axis] = joints[ends[i, 1], axis] - joints[ends[i, 0], axis]
            along += (box[axis] - joints[ends[i, 0], axis]) * axes[i, axis]
            square += axes[i, axis] * axes[i, axis]
        along = min(max(along / square, 0.0), 1.0)
        off = 0.0
        for axis in range(3):
            off += (joints[ends[i, 0], axis] + along * axes[i, axis] - box[axis]) ** 2
        to_box = min(to_box, np.sqrt(off))
        for j in range(i):
            between = min(between, _segment_gap(joints[ends[i, 0]], axes[i], joints[ends[j, 0]], axes[j]))
    return min(between - strut_diameter, to_box - 0.5 * strut_diameter - box_radius)


def clearance_m(joints_m: Array, box_m: Array, strut_diameter_m: float, box_radius_m: float) -> float:
    """Smallest gap between surfaces of struts, and of struts and box; joints_m is (12, 3), box_m (3,)."""
    return float(clearance(joints_m, box_m, STRUT_ENDS, strut_diameter_m, box_radius_m))
