# SPDX-License-Identifier: Apache-2.0
"""What the twin looks like in RViz or Foxglove."""

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sim_core.dynamics.robot import Robot
from sim_core.structure.arrays import Array
from sim_core.structure.topology import FACES, STRUTS, TENDONS
from sim_core.structure.urdf import BOX_SIDE_M, COLOURS, JOINT_THICKNESS
from tensegrity_robot.ros.conversions import point, pose

NAMESPACE = "twin"
TENDON_WIDTH_M = 0.003
GROUND_LIFT_M = 0.001
"""The face is drawn a little above the floor, so that a grid at z = 0 does not flicker through it."""

_SLACK = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.4)
_STRUT, _JOINT, _BOX = (ColorRGBA(**dict(zip("rgba", COLOURS[part], strict=True))) for part in ("strut", "joint", "box"))
_FACE = ColorRGBA(r=0.2, g=0.5, b=0.9, a=0.5)
_TEXT = ColorRGBA(r=0.9, g=0.9, b=0.9, a=1.0)


def markers(robot: Robot, face: str, header: Header, tendon_full_scale_n: float) -> MarkerArray:
    """Struts, tendons, joints, box, ground face and its name.

    Args:
        robot: in its state now.
        face: the face that it stands on; empty: none.
        header: frame and stamp of every marker.
        tendon_full_scale_n: tension drawn red; none is blue, slack tendons are pale.
    """
    places = robot.joints_m()
    prototype = robot.model.prototype
    forces = robot.cable_forces_n()[: len(TENDONS)]
    struts = _lines(header, 0, places, STRUTS, prototype.strut_diameter_m)
    struts.color = _STRUT
    tendons = _lines(header, 1, places, TENDONS, TENDON_WIDTH_M)
    tendons.colors = [colour for force in forces for colour in [_tension_colour(force / tendon_full_scale_n)] * 2]
    spheres = _marker(header, 2, Marker.SPHERE_LIST, JOINT_THICKNESS * prototype.strut_diameter_m, _JOINT)
    spheres.points = [point(place) for place in places]
    box = _marker(header, 3, Marker.CUBE, BOX_SIDE_M, _BOX)
    box.pose = pose(robot.box_m(), robot.quaternions()[-1])
    return MarkerArray(markers=[struts, tendons, spheres, box, *_ground_face(header, places, face)])


def _ground_face(header: Header, places: Array, face: str) -> list[Marker]:
    triangle = _marker(header, 4, Marker.TRIANGLE_LIST, 1.0, _FACE)
    name = _marker(header, 5, Marker.TEXT_VIEW_FACING, 0.04, _TEXT)
    if face not in FACES:
        triangle.action = name.action = Marker.DELETE
        return [triangle, name]
    corners = places[list(FACES[face])] * [1.0, 1.0, 0.0] + [0.0, 0.0, GROUND_LIFT_M]
    triangle.points = [point(corner) for corner in corners]
    name.text = face
    name.pose = pose(corners.mean(axis=0) - [0.0, 0.0, 0.03])
    return [triangle, name]


def _marker(header: Header, number: int, kind: int, size_m: float, colour: ColorRGBA | None = None) -> Marker:
    marker = Marker(header=header, ns=NAMESPACE, id=number, type=kind, action=Marker.ADD)
    marker.pose = pose(np.zeros(3))
    marker.scale = Vector3(x=size_m, y=size_m, z=size_m)
    if colour is not None:
        marker.color = colour
    return marker


def _lines(header: Header, number: int, places: Array, pairs: tuple[tuple[int, int], ...], width_m: float) -> Marker:
    marker = _marker(header, number, Marker.LINE_LIST, width_m)
    dots: list[Point] = [point(place) for place in places]
    marker.points = [dots[index] for pair in pairs for index in pair]
    return marker


def _tension_colour(share: float) -> ColorRGBA:
    if share <= 0.0:
        return _SLACK
    warm = min(share, 1.0)
    return ColorRGBA(r=warm, g=0.4 * (1.0 - abs(2.0 * warm - 1.0)) + 0.15, b=1.0 - warm, a=1.0)
