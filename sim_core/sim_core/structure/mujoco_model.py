# SPDX-License-Identifier: Apache-2.0
"""The same robot for MuJoCo: an MJCF built from `Elements` alone.

What carries over exactly: masses, inertias, the 48 cables (they only pull), their points, the sixty contact points, gravity, the
actuators' speed, stiffness EA / L of a strut along its axis. What cannot, and what stands for it:

* a strut is two rigid halves on a slide: it does not bend or twist (ours does, by hundredths of a millimetre);
* the slide's servo has the strut's stiffness and SERVO_DAMPING, more than the strut's own, so that steps of 5 ms are stable;
* mass damping has no counterpart in MJCF; `compiled` damps each degree of freedom by ζ times its inertia in the ideal shape, which
  is the same for translations and all but the same for rotations. A file carries ζ as the number `zeta_1_s`;
* contacts are MuJoCo's own soft constraints as they are by default, with the kinetic coefficient of friction only.

The integrator `implicitfast` is within 5 % of MuJoCo's fastest way to step this model; `discrete` needs ten times as long.
"""

import importlib
from typing import Any

import numpy as np

from sim_core.names import STRUT_NAMES
from sim_core.structure.arrays import Array
from sim_core.structure.elements import IMPROVED, Elements, face_down
from sim_core.structure.rotations import quaternion_of
from sim_core.structure.topology import JOINTS, POINTS_PER_JOINT, STRUTS, TENDONS

SERVO_DAMPING_N_S_M = 300.0
"""Of a strut's servo. A strut that moves at the actuator's speed lags by 0.05 mm."""
CONTACT_TIME_S = 0.02
"""Time constant of a contact: MuJoCo's default. Half of it, the shortest that MuJoCo accepts at 5 ms, never comes to rest at that
step."""
SPHERE_M = 1e-3
"""Contact points are spheres of this radius; the ground lies that much lower, so that they touch where the points would."""


def mjcf(e: Elements, step_s: float, integrator: str = "implicitfast", sensors: bool = False, face: str = "") -> str:
    """The model's XML.

    Args:
        e: the robot's elements.
        step_s: MuJoCo's time step, in [s].
        integrator: MuJoCo's name of it.
        sensors: with joints, their velocities, the box and the joints' ground forces as sensors, for judging; see `read_sensors`.
        face: put down on this face, not settled yet; empty: in body coordinates, centre at the origin.

    Raises:
        UnknownFaceError; ValueError: another model, or more elements a strut.
    """
    if e.kind != IMPROVED or len(e.beam_ends) != len(STRUTS):
        raise ValueError("the MuJoCo model is made of the improved model with one element per strut")
    turn, shift = np.eye(3), np.zeros(3)
    if face:
        turn = face_down(face)
        of_joint = np.repeat(np.arange(JOINTS), POINTS_PER_JOINT)
        points = e.position_m[of_joint] + np.einsum("nij,nj->ni", e.frame[of_joint], e.contact_point_m)
        shift[2] = -float((points @ turn[2]).min())
    particles = len(e.mass_kg)
    offsets = np.zeros((particles, 3))  # of each particle in its body's frame
    for strut, (first, second) in enumerate(STRUTS):
        offsets[first, 0], offsets[second, 0] = -0.5 * e.strut_mid_m[strut], 0.5 * e.strut_mid_m[strut]
    inside: list[list[str]] = [[_inertial(e, p, offsets[p])] for p in range(particles)]
    for joint in range(JOINTS):
        for point in range(joint * POINTS_PER_JOINT, (joint + 1) * POINTS_PER_JOINT):
            inside[joint].append(f'<geom class="foot" pos="{_text(offsets[joint] + e.contact_point_m[point])}"/>')
        inside[joint].append(f'<site name="N{joint + 1}" pos="{_text(offsets[joint])}" size="0.03"/>')
    tendons = []
    for cable, (ends, stiffness, rest) in enumerate(zip(e.cable_ends, e.cable_stiffness_n_m, e.cable_rest_m, strict=True)):
        for side, points in enumerate((e.cable_point_1_m, e.cable_point_2_m)):
            inside[ends[side]].append(f'<site name="c{cable}_{side}" pos="{_text(offsets[ends[side]] + points[cable])}"/>')
        tendons.append(
            f'<spatial name="{_cable_name(cable)}" stiffness="{stiffness:.17g}" springlength="0 {rest:.17g}">'
            f'<site site="c{cable}_0"/><site site="c{cable}_1"/></spatial>'
        )
    bodies = []
    for strut, (first, second) in enumerate(STRUTS):
        middle = turn @ (0.5 * (e.position_m[first] + e.position_m[second])) + shift
        relative = quaternion_of(e.frame[first].T @ e.frame[second])
        name = STRUT_NAMES[strut]
        bodies.append(
            f'<body name="{name}_outer" pos="{_text(middle)}" '
            f'quat="{_text(quaternion_of(turn @ e.frame[first]))}"><joint type="free"/>'
            f'{"".join(inside[first])}<body name="{name}_inner" quat="{_text(relative)}">'
            f'<joint name="{name}" type="slide" axis="1 0 0"/>'
            f"{''.join(inside[second])}</body></body>"
        )
    box = particles - 1
    bodies.append(
        f'<body name="box" pos="{_text(turn @ e.position_m[box] + shift)}" '
        f'quat="{_text(quaternion_of(turn @ e.frame[box]))}"><joint type="free"/>'
        f"{''.join(inside[box])}</body>"
    )
    servos = []
    for strut, name in enumerate(STRUT_NAMES):
        kp = e.beam_ea_n[strut] / e.strut_mid_m[strut]
        servos.append(
            f'<general name="{name}" joint="{name}" dyntype="integrator" gainprm="{kp:.17g}" biastype="affine" '
            f'biasprm="0 {-kp:.17g} {-SERVO_DAMPING_N_S_M}"/>'
        )
    watched = "".join(
        [f'<framepos objtype="site" objname="N{j + 1}"/>' for j in range(JOINTS)]
        + ['<framepos objtype="xbody" objname="box"/>']
        + [f'<framelinvel objtype="site" objname="N{j + 1}"/>' for j in range(JOINTS)]
        + [f'<touch site="N{j + 1}"/>' for j in range(JOINTS)]
    )
    return f"""<mujoco model="six struts">
<compiler angle="radian" autolimits="true" boundmass="0" balanceinertia="false"/>
<custom><numeric name="zeta_1_s" data="{e.zeta_1_s:.17g}"/></custom>
<option timestep="{step_s:.17g}" gravity="{_text(e.gravity_m_s2)}" integrator="{integrator}" cone="pyramidal"/>
<default><default class="foot"><geom type="sphere" size="{SPHERE_M}" mass="0" contype="1" conaffinity="0" condim="3"
 friction="{e.friction[1]:.17g} 0 0" solref="{CONTACT_TIME_S} 1"/></default></default>
<worldbody><geom type="plane" size="0 0 1" pos="0 0 {-SPHERE_M}" contype="0" conaffinity="1" friction="{e.friction[1]:.17g} 0 0"
 solref="{CONTACT_TIME_S} 1"/>
{"".join(bodies)}</worldbody>
<tendon>{"".join(tendons)}</tendon>
<actuator>{"".join(servos)}</actuator>
<sensor>{watched if sensors else ""}</sensor>
</mujoco>"""


def compiled(e: Elements, step_s: float, integrator: str = "implicitfast", sensors: bool = False) -> Any:
    """The `MjModel`, damped with the robot's ζ."""
    mujoco = importlib.import_module("mujoco")
    return damped(mujoco.MjModel.from_xml_string(mjcf(e, step_s, integrator, sensors)))


def damped(model: Any) -> Any:
    """An `MjModel` of such a file, damped with the ζ that is written in it."""
    mujoco = importlib.import_module("mujoco")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    model.dof_damping[:] = float(model.numeric("zeta_1_s").data[0]) * np.diag(inertia)
    return model


def positions_of(particles_m: Array, quaternions: Array) -> Array:
    """Generalised positions (55,) of a robot in the ideal shape, wherever it is: particles (P, 3), orientations (P, 4)."""
    parts: list[Any] = []
    for first, second in STRUTS:
        parts += [0.5 * (particles_m[first] + particles_m[second]), quaternions[first], [0.0]]
    return np.concatenate([*parts, particles_m[-1], quaternions[-1]])


def read_sensors(values: Array) -> tuple[Array, Array, Array, Array]:
    """Joints (..., 12, 3), box (..., 3), joints' velocities (..., 12, 3), joints' ground forces (..., 12)."""
    joints, box, speeds, forces = np.split(values, [36, 39, 75], axis=-1)
    return joints.reshape(*joints.shape[:-1], 12, 3), box, speeds.reshape(*speeds.shape[:-1], 12, 3), forces


def _cable_name(cable: int) -> str:
    return f"T{cable + 1}" if cable < len(TENDONS) else f"rope{cable + 1 - len(TENDONS)}"


def _inertial(e: Elements, p: int, at: Array) -> str:
    return f'<inertial pos="{_text(at)}" mass="{e.mass_kg[p]:.17g}" diaginertia="{_text(e.inertia_kg_m2[p])}"/>'


def _text(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in np.asarray(values))
