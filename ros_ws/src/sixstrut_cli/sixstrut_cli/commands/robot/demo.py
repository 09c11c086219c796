# SPDX-License-Identifier: Apache-2.0
"""`sixstrut demo`: the whole chain, rolling the virtual prototype."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.options import MOST_PERTURBATION, BoardOption, DomainOption, LibraryOption


def command(
    rolls: Annotated[int, typer.Option("--rolls", min=1, max=1000, help="How many rolls in a row.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Draws the route and the virtual prototype's true parameters.")] = 1,
    from_face: Annotated[str, typer.Option("--from-face", help="Face to start on: TC1..TC8, TO1..TO12.")] = "TC6",
    real_time: Annotated[
        bool, typer.Option("--real-time/--fast", help="Robot seconds as wall seconds, or eight times faster.")
    ] = False,
    perturbation: Annotated[
        float, typer.Option(min=0.0, max=MOST_PERTURBATION, help="How far the prototype is off, 0.05 for ±5 %.")
    ] = 0.05,
    board: BoardOption = "lsc",
    actuators: Annotated[str, typer.Option(help="The prototype's actuators: ideal, stand-in, or a YAML file.")] = "stand-in",
    library: LibraryOption = "robust",
    bags: Annotated[Path, typer.Option(help="Folder for the recorded bag and the picture.")] = Path("bags"),
    console: Annotated[bool, typer.Option("--console", help="Show it in the browser as well, while it runs.")] = False,
    domain: DomainOption = None,
) -> None:
    """Roll the virtual prototype with its twin: board emulator on a pty, bridge, planner and twin as separate processes.

    Every roll is a virtual one. Ctrl-C at any moment holds the struts, closes the bag and ends.

    sixstrut demo
    sixstrut demo --rolls 6 --seed 4 --from-face TO1
    sixstrut demo --real-time --perturbation 0.1
    sixstrut demo --console --real-time --rolls 10
    sixstrut demo --board maestro:crc
    """
    from tensegrity_lab.stack.virtual_stack import VirtualRobot
    from tensegrity_lab.studies.demo import Demo

    pace = 1.0 if real_time else 8.0
    robot = VirtualRobot(from_face, seed, perturbation, pace, board, actuators, library, bags)
    raise typer.Exit(Demo(rolls, robot, console, domain).run())
