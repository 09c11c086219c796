# SPDX-License-Identifier: Apache-2.0
"""The keep-in area: where on the floor the robot may roll on and travel."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sim_core.errors import ParameterError
from sim_core.planning.floor_planner import Floor, Shift, Stance
from sim_core.structure.arrays import Array

MOST_CORNERS = 100


class KeepIn:
    """A convex area of the floor.

    Attributes:
        corners_m: (n, 2), counterclockwise.
    """

    def __init__(self, corners_m: Array):
        """Args: corners_m: points, (n, 2); the area is their convex hull. Raises ParameterError: they span none."""
        points = np.asarray(corners_m, dtype=float)
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError) as error:
            raise ParameterError(
                f"the corners of the keep-in area span none: {points.tolist()}; valid are 3 or more, in m"
            ) from error
        self.corners_m = points[hull.vertices]
        self._normals, self._offsets = hull.equations[:, :2], hull.equations[:, 2]

    def outside_m(self, points_m: Array) -> float:
        """How far the outermost of points, (n, 2) or (n, 3), is outside; negative: how far all are inside."""
        return float((np.asarray(points_m)[..., :2] @ self._normals.T + self._offsets).max())

    def leads_out(self, floor: Floor, stance: Stance, faces: Sequence[str], shifts: Sequence[Shift]) -> str:
        """Onto which of these faces, rolled one after the other with these shifts, the robot would come out; empty: none."""
        for face, shift in zip(faces, shifts, strict=True):
            stance = floor.rolled(stance, face, shift)
            if self.outside_m(floor.joints_m(stance)) > 0.0:
                return face
        return ""


def parsed_keep_in(text: str) -> KeepIn | None:
    """The area of a text such as "-1 -1, 2 -1, 2 1.5" (x and y in m, corner by corner); empty: None. Raises ParameterError."""
    if not text.strip():
        return None
    try:
        corners = np.array([[float(number) for number in corner.split()] for corner in text.split(",")])
        if corners.ndim != 2 or corners.shape[1] != 2 or not 3 <= len(corners) <= MOST_CORNERS or not np.isfinite(corners).all():
            raise ValueError("corners")
    except ValueError as error:
        raise ParameterError(
            f"keep_in is {text!r}: valid are 3 or more corners, x and y in m, such as -1 -1, 2 -1, 2 1.5"
        ) from error
    return KeepIn(corners)
