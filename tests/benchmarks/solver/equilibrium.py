# SPDX-License-Identifier: Apache-2.0
"""Both engines at rest on a face: the same heights, rope tensions and strut forces?"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.mujoco_model import compiled, positions_of, read_sensors
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import TENDONS

STEP_S, SETTLE_S = 0.001, 8.0


@dataclass(frozen=True)
class Rest:
    """One face. Pairs are (sixstrut, MuJoCo).

    Attributes:
        height_m: of the centre of mass.
        tendon_n, strut_n: mean force of tendons, mean compression of struts.
        worst_tendon, worst_strut: largest difference of one member, as a share of the mean force of its kind.
    """

    face: str
    height_m: tuple[float, float]
    tendon_n: tuple[float, float]
    strut_n: tuple[float, float]
    worst_tendon: float
    worst_strut: float


def rests(prototype: Prototype, faces: Sequence[str] = ("TC6", "TO5")) -> list[Rest]:
    """Settle both engines on each face; MuJoCo begins where ours rests."""
    mujoco = importlib.import_module("mujoco")
    model = build_model(prototype)
    e, tendons = model.elements, len(TENDONS)
    other = compiled(e, STEP_S, sensors=True)
    found = []
    for face in faces:
        robot = Robot.resting_on(model, face)
        data = mujoco.MjData(other)
        frames = robot.quaternions()
        data.qpos[:] = positions_of(np.vstack([robot.joints_m(), robot.box_m()]), frames)
        for _ in range(round(SETTLE_S / STEP_S)):
            mujoco.mj_step(other, data)
        joints, box, _, _ = read_sensors(data.sensordata)
        height = float(e.mass_kg @ np.append(joints[:, 2], box[2]) / e.mass_kg.sum())
        stretch = data.ten_length[:tendons] - other.tendon_lengthspring[:tendons, 1]
        pulls = robot.cable_forces_n()[:tendons], np.maximum(0.0, other.tendon_stiffness[:tendons] * stretch)
        pushes = -robot.strut_forces_n(), np.abs(data.actuator_force)
        found.append(
            Rest(
                face,
                (float(robot.center_of_mass_m()[2]), height),
                (float(pulls[0].mean()), float(pulls[1].mean())),
                (float(pushes[0].mean()), float(pushes[1].mean())),
                float(np.abs(pulls[1] - pulls[0]).max() / pulls[0].mean()),
                float(np.abs(pushes[1] - pushes[0]).max() / pushes[0].mean()),
            )
        )
    return found
