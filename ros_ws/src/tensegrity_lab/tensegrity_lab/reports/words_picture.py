# SPDX-License-Identifier: Apache-2.0
"""The robot at rest with its parts by name: for the words that the documentation uses."""

from pathlib import Path

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import FACES, STRUTS, TENDONS
from tensegrity_lab.reports.animation import DPI, Scene, Stand, moment_of
from tensegrity_lab.reports.figure import GREEN, ORANGE, halo, picture_file


@picture_file
def words_picture(path: Path, prototype: Prototype, face: str = "TC6") -> None:
    """Draw a robot at rest on a face, with one closed and one open face, a strut, a tendon and the box named."""
    moment = moment_of(0.0, Robot.resting_on(build_model(prototype), face))
    scene = Scene([moment, moment], [Stand(0.0, face)], "")
    axes = scene.new_axes()
    scene.draw_floor(axes, moment)
    scene.draw_robot(axes, moment)
    joints = moment.joints_m
    middle = joints.mean(axis=0)
    notes = [(moment.box_m, "control box", "#22303c", (-225, -55))]
    for kind, color, told, where in (
        ("TC", GREEN, "closed: three tendons", (-145, 95)),
        ("TO", ORANGE, "open: two tendons", (70, 60)),
    ):
        name = max(
            (one for one in FACES if one.startswith(kind)),
            key=lambda one: _faces_eye(joints[list(FACES[one])], middle, scene.eye_m),
        )
        corners = joints[list(FACES[name])]
        flat = scene.flat(corners)[:, :2]
        axes.fill(*flat.T, fc=color, alpha=0.28, zorder=30)
        axes.fill(*flat.T, fc="none", ec=color, lw=2.0, ls="--" if kind == "TO" else "-", zorder=31)
        notes.append((corners.mean(axis=0), f"{name}, {told}", color, where))
    strut = max(range(6), key=lambda one: -scene.flat(joints[list(STRUTS[one])])[:, 2].mean())
    a, b = STRUTS[strut]
    notes.append((joints[a] + 0.2 * (joints[b] - joints[a]), f"strut S{strut + 1}, a linear actuator", "#22303c", (55, -75)))
    tendon = max(range(24), key=lambda one: scene.flat(joints[list(TENDONS[one])])[:, 0].mean())
    notes.append((joints[list(TENDONS[tendon])].mean(axis=0), f"tendon T{tendon + 1}", "#22303c", (60, -35)))
    for point, text, color, offset in notes:
        axes.annotate(
            text, scene.flat(point)[0, :2], xytext=offset, textcoords="offset points", fontsize=10, color="#22303c", zorder=40,
            path_effects=[halo()], va="center", arrowprops={"arrowstyle": "-", "color": color, "lw": 1.2},
        )  # fmt: skip
    scene.figure.savefig(path, dpi=DPI)


def _faces_eye(corners_m: np.ndarray, middle_m: np.ndarray, eye_m: np.ndarray) -> float:
    """How much a face looks at the eye: 1 straight, below 0 away."""
    outward = corners_m.mean(axis=0) - middle_m
    towards = eye_m - corners_m.mean(axis=0)
    return float(outward @ towards / np.linalg.norm(outward) / np.linalg.norm(towards))
