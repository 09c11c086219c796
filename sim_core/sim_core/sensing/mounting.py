# SPDX-License-Identifier: Apache-2.0
"""How an inertial sensor sits in the box, from where it feels up on faces that somebody knows; and the file that keeps it."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.errors import ParameterError, brief
from sim_core.files.yaml_reader import read_yaml_or, sealed
from sim_core.sensing.face_filter import NAMES, shape_of
from sim_core.structure.arrays import Array
from sim_core.structure.rotations import matrix_of, quaternion_of

LEAST_FACES = 3
MOST_OFF_RAD = math.radians(4.0)
"""A direction that fits worse is of another face, or of a floor that leans, or the sensor was moved in between."""


class Mounting(NamedTuple):
    """What was found.

    Attributes:
        rotation: from the sensor's axes to the box's, (3, 3).
        off_rad: how badly each face fits.
    """

    rotation: Array
    off_rad: Mapping[str, float]


def found_mounting(model: Model, felt: Mapping[str, Array], box_share: float) -> Mounting:
    """The rotation that fits what was felt best (least squares; Wahba's problem).

    Args:
        model: the robot's, in neutral on level ground.
        felt: face -> mean acceleration at rest on it, (3,), upward, in the sensor's axes; whatever unit.
        box_share: of the box in the robot's mass.

    Raises:
        ParameterError: too few faces, none of them a TO, or faces that do not fit together.
        UnknownFaceError.
    """
    if len(felt) < LEAST_FACES or not any(face.startswith("TO") for face in felt):
        got = ", ".join(felt) or "none"
        raise ParameterError(
            f"faces {got}: valid are {LEAST_FACES} or more, at least one of them a TO: TC faces alone look the same to a sensor "
            "that is turned by 90 degrees"
        )
    ups = []
    for face in felt:
        robot = Robot.resting_on(model, face)
        shape = shape_of(robot.joints_m(), robot.box_m(), robot.quaternions()[-1], box_share)
        ups.append(-shape.normals[NAMES.index(face)])
    seen = np.array([up / np.linalg.norm(up) for up in felt.values()])
    rotation = Rotation.align_vectors(np.array(ups), seen)[0].as_matrix()
    cosines = np.clip(np.einsum("ij,ij->i", np.array(ups), seen @ rotation.T), -1.0, 1.0)
    off_rad = dict(zip(felt, map(float, np.arccos(cosines)), strict=True))
    worst = max(off_rad, key=off_rad.__getitem__)
    if off_rad[worst] > MOST_OFF_RAD:
        raise ParameterError(
            f"the directions felt do not fit together: {worst} is off by {math.degrees(off_rad[worst]):.1f} degrees, valid are "
            f"{math.degrees(MOST_OFF_RAD):g}; name the faces again, on a level floor, and see that the sensor is fixed"
        )
    return Mounting(rotation, off_rad)


def mounting_text(mounting: Mounting) -> str:
    """The YAML."""
    w, x, y, z = (float(value) for value in quaternion_of(mounting.rotation))
    off = ", ".join(f"{face}: {math.degrees(off_rad):.2f}" for face, off_rad in mounting.off_rad.items())
    return sealed(
        "# How the inertial sensor sits in the box of one robot, found with `./sixstrut calibrate imu`.\n"
        f"quaternion: [{w:.6f}, {x:.6f}, {y:.6f}, {z:.6f}]  # w x y z, from the sensor's axes to the box's\n"
        f"off_deg: {{{off}}}  # how badly each face fitted\n"
    )


def load_mounting(path: Path | str) -> Array:
    """The rotation from the sensor's axes to the box's, (3, 3), as a file has it. Raises ParameterError."""
    found = read_yaml_or(ParameterError, path, "mounting", "; find it with: ./sixstrut calibrate imu")
    values = found.get("quaternion") if isinstance(found, Mapping) else None
    if isinstance(values, Sequence) and not isinstance(values, str) and len(values) == 4:
        turn = np.array([value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan for value in values])
        if abs(float(np.linalg.norm(turn)) - 1.0) < 0.01:
            return np.asarray(matrix_of(turn / np.linalg.norm(turn)))
    raise ParameterError(f"mounting {path}: quaternion is {brief(values)}, valid are four numbers w, x, y, z of length 1")
