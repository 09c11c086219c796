# SPDX-License-Identifier: Apache-2.0
"""`sixstrut export`: the robot as a file for other tools."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import in_folder, require_output, wrote

MJCF_STEP_S = 0.001


def command(
    kind: Annotated[Literal["urdf", "mjcf"], typer.Argument(metavar="urdf|mjcf", help="For viewers, or for MuJoCo.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")],
    prototype: options.Prototype = None,
    face: Annotated[str, typer.Option(help="MJCF: the face that the robot is put down on, not settled yet.")] = "TC6",
) -> None:
    """Write the robot as URDF (what the twin publishes as robot_description) or as MJCF (what `bench` compares with).

    A URDF is for looking at: its links float, and TF places them. An MJCF moves: ropes, servos, ground.
    MJCF has no mass damping: sim_core.structure.mujoco_model.damped applies it to the loaded model.

    sixstrut export urdf out/robot.urdf
    sixstrut export mjcf out/robot.xml --face TO5
    """
    require_output(file, f"{kind.upper()} file")
    from sim_core.structure.elements import elements_of
    from sim_core.structure.mujoco_model import mjcf
    from sim_core.structure.parameters import load_prototype
    from sim_core.structure.topology import require_face
    from sim_core.structure.urdf import urdf

    robot = load_prototype(prototype)
    require_face(face)
    try:
        text = urdf(robot) if kind == "urdf" else mjcf(elements_of(robot), MJCF_STEP_S, face=face)
    except ValueError as error:
        raise typer.BadParameter(f"{prototype}: {error}") from error
    in_folder(file).write_text(text, encoding="utf-8")
    wrote(file)
