"""On which face the robot stands, and how near its parts are to each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sim_core.elements import Array
from sim_core.structure import FACE_OF_NODES, STRUTS

_STRUT_ENDS = np.array(STRUTS, dtype=np.int32)


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


def judge_footing(joints_m: Array, center_of_mass_m: Array, ground_force_n: Array, carry_n: float, down: Array) -> Footing:
    """The base face: the three joints that carry the weight, with the centre of mass's projection inside their triangle.

    Args:
        joints_m: (12, 3). center_of_mass_m: (3,). ground_force_n: (12,) normal force per joint.
        carry_n: a joint that carries more than this touches the ground.
        down: (3,) direction of gravity.
    """
    carrying = tuple(int(i) for i in np.flatnonzero(ground_force_n > carry_n))
    names = ", ".join(str(i + 1) for i in carrying)
    if len(carrying) != 3:
        what = f"rests on {len(carrying)} joints ({names})" if carrying else "does not touch the ground"
        return Footing(None, what, carrying, float("nan"))
    flat = joints_m[list(carrying), :2]
    point = (center_of_mass_m - down * (center_of_mass_m[2] / down[2]))[:2]
    margin = _inside(flat, point)
    face = FACE_OF_NODES.get(frozenset(carrying))
    if face is None:
        return Footing(None, f"rests on joints {names}, which are no face", carrying, margin)
    if margin < 0.0:
        return Footing(None, f"rests on {face} with the centre of mass outside it", carrying, margin)
    return Footing(face, face, carrying, margin)


def _inside(triangle: Array, point: Array) -> float:
    """Signed distance of a point from the nearest edge line of a triangle (3, 2), positive inside."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    to_point = point - triangle
    cross = edges[:, 0] * to_point[:, 1] - edges[:, 1] * to_point[:, 0]
    orientation = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
    lengths = np.linalg.norm(edges, axis=1)
    if abs(orientation) < 1e-12 or (lengths < 1e-9).any():
        return float("-inf")
    return float(np.min(np.sign(orientation) * cross / lengths))


@njit(cache=True)
def _segment_gap(p, d1, q, d2):
    """Distance between segments p + s d1 and q + t d2, s and t in [0, 1] (closest points, clamped)."""
    a, e = d1 @ d1, d2 @ d2
    r = p - q
    f, c, b = d2 @ r, d1 @ r, d1 @ d2
    denominator = a * e - b * b
    s = min(max((b * f - c * e) / denominator, 0.0), 1.0) if denominator > 1e-12 * a * e else 0.0
    t = (b * s + f) / e
    if t < 0.0:
        t, s = 0.0, min(max(-c / a, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((b - c) / a, 0.0), 1.0)
    gap = p + s * d1 - q - t * d2
    return np.sqrt(gap @ gap)


@njit(cache=True)
def _gaps(joints, box, ends):
    struts, to_box = np.inf, np.inf
    for i in range(6):
        p = joints[ends[i, 0]]
        d1 = joints[ends[i, 1]] - p
        along = min(max(((box - p) @ d1) / (d1 @ d1), 0.0), 1.0)
        off = p + along * d1 - box
        to_box = min(to_box, np.sqrt(off @ off))
        for j in range(i):
            q = joints[ends[j, 0]]
            struts = min(struts, _segment_gap(p, d1, q, joints[ends[j, 1]] - q))
    return struts, to_box


def clearance_m(joints_m: Array, box_m: Array, strut_diameter_m: float, box_radius_m: float) -> float:
    """Smallest gap between surfaces: of two struts, or of a strut and the box (a sphere). Struts are straight cylinders."""
    between, to_box = _gaps(np.ascontiguousarray(joints_m), np.ascontiguousarray(box_m), _STRUT_ENDS)
    return float(min(between - strut_diameter_m, to_box - 0.5 * strut_diameter_m - box_radius_m))
