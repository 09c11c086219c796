# SPDX-License-Identifier: Apache-2.0
"""The robot as a URDF, for viewers: a box, and per strut an outer and an inner part, all floating.

A tensegrity is no tree of joints, so every link hangs on `base_link` by a floating joint, and its pose comes from TF. The joints'
origins are the ideal shape's. A strut's outer part begins at its first node, the inner part at its second and slides in it.
"""

from typing import Any
from xml.etree import ElementTree

import numpy as np

from sim_core.names import STRUT_NAMES
from sim_core.structure.arrays import Array
from sim_core.structure.elements import elements_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import STRUTS

BASE, BOX, IMU = "base_link", "box", "imu_link"
NODE_NAMES = tuple(f"N{node + 1}" for node in range(12))
LINKS: dict[str, int] = {
    BOX: 12,
    **{f"{name}_outer": first for name, (first, _) in zip(STRUT_NAMES, STRUTS, strict=True)},
    **{f"{name}_inner": second for name, (_, second) in zip(STRUT_NAMES, STRUTS, strict=True)},
    **{name: node for node, name in enumerate(NODE_NAMES)},
}
"""Every link but `base_link` -> whose pose it has: index of a joint (0..11), or 12 for the box; x is the strut's axis."""

BOX_SIDE_M = 0.04
JOINT_THICKNESS = 1.4
"""Diameter of a drawn joint, in strut diameters."""
INNER_THICKNESS = 0.7
COLOURS = {
    "strut": (0.25, 0.27, 0.32, 1.0),
    "rod": (0.75, 0.77, 0.8, 1.0),
    "joint": (0.95, 0.75, 0.2, 1.0),
    "box": (0.2, 0.6, 0.35, 1.0),
}
"""Red, green, blue, opacity, of all that is drawn for viewers."""


def urdf(prototype: Prototype, prefix: str = "", mounting: Array | None = None) -> str:
    """The robot's URDF, with masses and inertias.

    Args:
        prototype: the robot's numbers.
        prefix: of every link, such as `robot1/`.
        mounting: rotation (3, 3) from the axes of an inertial sensor, the link `imu_link`, to the box's; None: they are the same.
    """
    e = elements_of(prototype)
    root = ElementTree.Element("robot", name="sixstrut")
    for name, colour in COLOURS.items():
        ElementTree.SubElement(ElementTree.SubElement(root, "material", name=name), "color", rgba=_text(colour))
    ElementTree.SubElement(root, "link", name=prefix + BASE)
    for name, index in LINKS.items():
        link = ElementTree.SubElement(root, "link", name=prefix + name)
        at = len(e.position_m) - 1 if name == BOX else index
        if name == BOX:
            _visual(link, "box", "box", size=_text([BOX_SIDE_M] * 3))
            _inertial(link, prototype.box_mass_kg, prototype.box_inertia_kg_m2)
        elif name in NODE_NAMES:
            _visual(link, "joint", "sphere", radius=_text([0.5 * JOINT_THICKNESS * prototype.strut_diameter_m]))
            _inertial(link, prototype.joint_mass_kg, prototype.joint_inertia_kg_m2)
        else:
            _strut_part(link, prototype, outer=name.endswith("_outer"))
        joint = ElementTree.SubElement(root, "joint", name=f"{prefix}{name}_joint", type="floating")
        ElementTree.SubElement(joint, "parent", link=prefix + BASE)
        ElementTree.SubElement(joint, "child", link=prefix + name)
        ElementTree.SubElement(joint, "origin", xyz=_text(e.position_m[at]), rpy=_text(_roll_pitch_yaw(e.frame[at])))
    ElementTree.SubElement(root, "link", name=prefix + IMU)
    joint = ElementTree.SubElement(root, "joint", name=f"{prefix}{IMU}_joint", type="fixed")
    ElementTree.SubElement(joint, "parent", link=prefix + BOX)
    ElementTree.SubElement(joint, "child", link=prefix + IMU)
    turn = np.eye(3) if mounting is None else mounting
    ElementTree.SubElement(joint, "origin", xyz=_text([0.0] * 3), rpy=_text(_roll_pitch_yaw(turn)))
    ElementTree.indent(root)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _strut_part(link: ElementTree.Element, prototype: Prototype, outer: bool) -> None:
    """A cylinder along x, from the link's node towards the other one: the inner part still meets the outer one when longest."""
    length = 0.5 * prototype.strut_length_m + (0.0 if outer else prototype.actuator_stroke_m)
    diameter = prototype.strut_diameter_m * (1.0 if outer else INNER_THICKNESS)
    middle = {"xyz": _text([0.5 * length * (1.0 if outer else -1.0), 0.0, 0.0]), "rpy": _text([0.0, 0.5 * np.pi, 0.0])}
    material = "strut" if outer else "rod"
    _visual(link, material, "cylinder", middle, radius=_text([0.5 * diameter]), length=_text([length]))
    mass = 0.5 * prototype.actuator_mass_kg
    across = mass * (3.0 * (0.5 * diameter) ** 2 + length**2) / 12.0
    _inertial(link, mass, (across, across, 0.5 * mass * (0.5 * diameter) ** 2), middle)


def _visual(link: ElementTree.Element, material: str, shape: str, origin: dict[str, str] | None = None, **size: str) -> None:
    visual = ElementTree.SubElement(link, "visual")
    if origin:
        ElementTree.SubElement(visual, "origin", origin)
    ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), shape, size)
    ElementTree.SubElement(visual, "material", name=material)


def _inertial(link: ElementTree.Element, mass_kg: float, inertia_kg_m2: Any, origin: dict[str, str] | None = None) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    if origin:
        ElementTree.SubElement(inertial, "origin", origin)
    ElementTree.SubElement(inertial, "mass", value=_text([mass_kg]))
    moments = {axis: _text([value]) for axis, value in zip(("ixx", "iyy", "izz"), inertia_kg_m2, strict=True)}
    ElementTree.SubElement(inertial, "inertia", moments | {"ixy": "0", "ixz": "0", "iyz": "0"})


def _roll_pitch_yaw(matrix: Any) -> tuple[float, float, float]:
    """URDF's fixed-axis angles of a rotation matrix (3, 3), in rad."""
    across = float(np.hypot(matrix[0, 0], matrix[1, 0]))
    pitch = float(np.arctan2(-matrix[2, 0], across))
    if across < 1e-9:  # looking straight up or down, only the sum of roll and yaw is known
        return float(np.arctan2(-matrix[1, 2], matrix[1, 1])), pitch, 0.0
    return float(np.arctan2(matrix[2, 1], matrix[2, 2])), pitch, float(np.arctan2(matrix[1, 0], matrix[0, 0]))


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
