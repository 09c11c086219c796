# SPDX-License-Identifier: Apache-2.0
"""The robot as particles, beams, cables and contact points with explicit numbers: what the kernel, and any other solver, needs."""

import hashlib
import math
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.rotations import dot, norm, rotated, turn_onto, unit
from sim_core.structure.topology import FACES, NODES, POINTS_PER_JOINT, STRUTS, TENDONS, require_face

IMPROVED, PREVIOUS = "improved", "previous"
"""The paper's two models."""
PREVIOUS_STEP_SHARE = 0.8
"""Time step of the previous model / its limit: fixes its fictitious masses."""
KINDS = (IMPROVED, PREVIOUS)


@dataclass(frozen=True)
class Elements:
    """One robot's numbers, member by member, so that each may differ from its neighbour. SI units; arrays are read-only.

    Particles are the 12 joints, the struts' inner particles (strut by strut), and the control box, in this order: P of them.

    Attributes:
        position_m: (P, 3) body coordinates in the ideal shape, centre at the origin.
        frame: (P, 3, 3) each particle's own axes as columns, in body coordinates; the first is the strut's axis.
        mass_kg: (P,).
        inertia_kg_m2: (P, 3) about the particle's own axes.
        beam_ends: int (B, 2) particles of each beam.
        beam_strut: int (B,) its strut.
        beam_ea_n, beam_ei_n_m2, beam_gj_n_m2: (B,).
        beam_share: (B,) share of the strut's rest length.
        cable_ends: int (48, 2) particles; the first 24 cables are tendons T1..T24, the others the box's ropes.
        cable_stiffness_n_m, cable_rest_m: (48,).
        cable_point_1_m, cable_point_2_m: (48, 3) slave points in the particles' own axes.
        contact_point_m: (60, 3) in the joint's own axes, five of each joint.
        strut_mid_m: (6,) rest length at mid stroke.
        strut_gain: (6,) stroke made / stroke commanded.
        strut_speed_m_s: (6,).
        gravity_m_s2: (3,) in axes whose z is the ground's normal.
        ground_stiffness_n_m, ground_damping_n_s_m: (2,) normal, tangential.
        friction: (2,) static, kinetic.
        zeta_1_s: mass damping.
        steps_per_second: 1 / time step.
        kind: IMPROVED (dynamics) or PREVIOUS (quasi-static).
        mass_factor: fictitious masses / real ones, for PREVIOUS; else 1.
    """

    position_m: Array
    frame: Array
    mass_kg: Array
    inertia_kg_m2: Array
    beam_ends: NDArray[np.int32]
    beam_strut: NDArray[np.int32]
    beam_ea_n: Array
    beam_ei_n_m2: Array
    beam_gj_n_m2: Array
    beam_share: Array
    cable_ends: NDArray[np.int32]
    cable_stiffness_n_m: Array
    cable_rest_m: Array
    cable_point_1_m: Array
    cable_point_2_m: Array
    contact_point_m: Array
    strut_mid_m: Array
    strut_gain: Array
    strut_speed_m_s: Array
    gravity_m_s2: Array
    ground_stiffness_n_m: Array
    ground_damping_n_s_m: Array
    friction: Array
    zeta_1_s: float
    steps_per_second: int
    kind: str = IMPROVED
    mass_factor: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value = np.ascontiguousarray(value)
                value.setflags(write=False)
                object.__setattr__(self, field.name, value)

    @property
    def hash(self) -> str:
        """Identifies the model: sha256 over every number, 16 hex digits."""
        digest = hashlib.sha256()
        for field in fields(self):
            value = np.asarray(getattr(self, field.name))
            digest.update(f"{field.name}{value.shape}{value.dtype}".encode())
            digest.update(value.tobytes())
        return digest.hexdigest()[:16]

    def as_dict(self) -> dict[str, object]:
        """Plain lists and numbers, for JSON: enough to build the robot in another solver."""
        return {
            field.name: value.tolist() if isinstance(value := getattr(self, field.name), np.ndarray) else value
            for field in fields(self)
        }


def strut_axis(strut: int) -> Array:
    """Unit vector from end 1 to end 2 of a strut, body coordinates."""
    first, second = STRUTS[strut]
    return unit(NODES[second] - NODES[first])


def face_down(face: str) -> Array:
    """The smallest rotation (3, 3) of the ideal shape that puts a face down. Raises UnknownFaceError."""
    corners = NODES[list(FACES[require_face(face)])]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal = unit(normal) * np.sign(dot(normal, corners[0]))
    return turn_onto(normal, np.array([0.0, 0.0, -1.0]))


def _strut_frame(strut: int) -> Array:
    """Columns: the strut's axis, the inward direction (across it, to the centre), and their cross product."""
    axis, node = strut_axis(strut), NODES[STRUTS[strut][0]]
    inward = unit(-(node - dot(node, axis) * axis))
    return np.stack([axis, inward, np.cross(axis, inward)], axis=1)


def strut_of_node(node: int) -> int:
    """Index of the strut that ends in a node."""
    return next(s for s, ends in enumerate(STRUTS) if node in ends)


def _tendon_point(prototype: Prototype, node: int, other: int) -> Array:
    """Where a tendon of `node` that goes to `other` is tied, in body coordinates relative to the node."""
    axis, chord = strut_axis(strut_of_node(node)), NODES[other] - NODES[node]
    return prototype.tendon_point_radius_m * unit(chord - dot(chord, axis) * axis)


def elements_of(prototype: Prototype) -> Elements:
    """Build the elements of a prototype in the ideal shape (struts at mid stroke)."""
    length, per_strut = prototype.strut_length_m, prototype.strut_elements
    position = [length * node for node in NODES]
    frame = [_strut_frame(strut_of_node(node)) for node in range(12)]
    mass = [prototype.joint_mass_kg + 0.5 * prototype.actuator_mass_kg / per_strut] * 12
    inertia = [prototype.joint_inertia_kg_m2] * 12
    beam_ends: list[tuple[int, int]] = []
    for strut, (first, second) in enumerate(STRUTS):
        chain = [first, *range(len(position), len(position) + per_strut - 1), second]
        for k in range(1, per_strut):
            position.append(length * (NODES[first] + (NODES[second] - NODES[first]) * k / per_strut))
            frame.append(_strut_frame(strut))
            mass.append(prototype.actuator_mass_kg / per_strut)
            inertia.append(tuple(value / per_strut for value in prototype.strut_particle_inertia_kg_m2))
        beam_ends += list(pairwise(chain))
    box = len(position)
    position.append(np.zeros(3))
    frame.append(np.eye(3))
    mass.append(prototype.box_mass_kg)
    inertia.append(prototype.box_inertia_kg_m2)

    ends, stiffness, rest, points_1, points_2 = [], [], [], [], []

    def tie(p1: int, p2: int, arm_1: Array, arm_2: Array, k: float, stretch: float) -> None:
        ends.append((p1, p2))
        stiffness.append(k)
        rest.append(float(norm(position[p2] + arm_2 - position[p1] - arm_1)) / stretch)
        points_1.append(rotated(frame[p1].T, arm_1))
        points_2.append(rotated(frame[p2].T, arm_2))

    for i, j in TENDONS:
        arms = _tendon_point(prototype, i, j), _tendon_point(prototype, j, i)
        tie(i, j, *arms, prototype.tendon_stiffness_n_m, prototype.tendon_stretch)
    angle = math.radians(prototype.box_rope_point_angle_deg)
    for node in range(12):
        _, inward, side = frame[node].T
        for sign in (1.0, -1.0):
            arm = prototype.box_rope_point_radius_m * (math.cos(angle) * inward + sign * math.sin(angle) * side)
            at_box = prototype.box_rope_reach_m * (unit(NODES[node]) + sign * prototype.box_rope_spread * side)
            tie(node, box, arm, at_box, prototype.box_rope_stiffness_n_m, prototype.box_rope_stretch)

    contacts = []
    for node in range(12):
        strut = strut_of_node(node)
        outward = strut_axis(strut) * (-1.0 if node == STRUTS[strut][0] else 1.0)
        others = [b if a == node else a for a, b in TENDONS if node in (a, b)]
        arms_of_joint = [prototype.contact_tip_m * outward]
        arms_of_joint += [_tendon_point(prototype, node, o) + prototype.contact_rim_m * outward for o in others]
        contacts += [rotated(frame[node].T, arm) for arm in arms_of_joint]

    beams = len(beam_ends)
    node_mass = prototype.joint_mass_kg + 0.5 * prototype.actuator_mass_kg
    springs = np.array([prototype.contact_stiffness_n_m, prototype.contact_tangential_stiffness_n_m])
    ratios = np.array([prototype.contact_damping_ratio, prototype.contact_tangential_damping_ratio])
    tilt_x, tilt_y = prototype.ground_slope_rad
    # gravity seen from the ground: first tilted about x, then about y
    down = np.array([math.sin(tilt_y) * math.cos(tilt_x), -math.sin(tilt_x), -math.cos(tilt_y) * math.cos(tilt_x)])
    return Elements(
        position_m=np.array(position),
        frame=np.array(frame),
        mass_kg=np.array(mass),
        inertia_kg_m2=np.array(inertia),
        beam_ends=np.array(beam_ends, dtype=np.int32),
        beam_strut=np.repeat(np.arange(6, dtype=np.int32), per_strut),
        beam_ea_n=np.full(beams, prototype.strut_axial_stiffness_n_m * length),
        beam_ei_n_m2=np.full(beams, prototype.strut_bending_stiffness_n_m2),
        beam_gj_n_m2=np.full(beams, prototype.strut_torsion_stiffness_n_m2),
        beam_share=np.full(beams, 1.0 / per_strut),
        cable_ends=np.array(ends, dtype=np.int32),
        cable_stiffness_n_m=np.array(stiffness),
        cable_rest_m=np.array(rest),
        cable_point_1_m=np.array(points_1),
        cable_point_2_m=np.array(points_2),
        contact_point_m=np.array(contacts),
        strut_mid_m=np.full(6, length),
        strut_gain=np.ones(6),
        strut_speed_m_s=np.full(6, prototype.actuator_speed_m_s),
        gravity_m_s2=prototype.gravity_m_s2 * down,
        ground_stiffness_n_m=springs,
        ground_damping_n_s_m=2.0 * ratios * np.sqrt(springs * node_mass),
        friction=np.array([prototype.friction_static, prototype.friction_kinetic]),
        zeta_1_s=prototype.zeta_1_s,
        steps_per_second=prototype.steps_per_second,
    )


def previous_elements_of(prototype: Prototype) -> Elements:
    """The paper's previous model of a prototype: axial bars, joints without size, the box a point on its ropes.

    Ropes and ground meet the struts' axes at the nodes (the five contact points of a joint coincide there and share its
    stiffness), and nothing resists rotation. Natural lengths follow from the same stretch of these ropes. Fictitious masses are the
    real ones times one factor, chosen so that relaxation is quick at the prototype's time step; weights are the real ones.
    """
    sizeless = replace(
        prototype,
        strut_elements=1,
        tendon_point_radius_m=0.0,
        box_rope_point_radius_m=0.0,
        box_rope_reach_m=0.0,
        contact_tip_m=0.0,
        contact_rim_m=0.0,
    )
    e = elements_of(sizeless)
    # the stiffest motion: a strut's ends against each other at the shortest length, its nodes pressed onto the ground
    shortest = 1.0 - prototype.actuator_stroke_m / prototype.strut_length_m
    ground = max(prototype.contact_stiffness_n_m, prototype.contact_tangential_stiffness_n_m)
    ropes = 4 * prototype.tendon_stiffness_n_m + 2 * prototype.box_rope_stiffness_n_m
    stiffest = 2.0 * prototype.strut_axial_stiffness_n_m / shortest + ground + 2.0 * ropes
    mass = stiffest * (1.0 / prototype.steps_per_second) ** 2 / (2.0 * PREVIOUS_STEP_SHARE) ** 2
    factor = mass / float(e.mass_kg[:-1].min())
    return replace(
        e,
        beam_ei_n_m2=np.zeros(len(e.beam_ei_n_m2)),
        beam_gj_n_m2=np.zeros(len(e.beam_gj_n_m2)),
        ground_stiffness_n_m=e.ground_stiffness_n_m / POINTS_PER_JOINT,
        ground_damping_n_s_m=e.ground_damping_n_s_m * np.sqrt(factor) / POINTS_PER_JOINT,
        zeta_1_s=0.0,
        kind=PREVIOUS,
        mass_factor=factor,
    )
