# SPDX-License-Identifier: Apache-2.0
"""`sixstrut demo`: the whole chain, rolling the virtual prototype."""

import os
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce


def command(
    rolls: Annotated[int, typer.Option("--rolls", min=1, max=1000, help="How many rolls in a row.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Draws the route and the virtual prototype's true parameters.")] = 1,
    from_face: options.FromFace = "TC6",
    real_time: Annotated[
        bool | None,
        typer.Option(
            "--real-time/--fast",
            help="Robot seconds as wall seconds, or eight times faster; default: fast, if there are two processors.",
        ),
    ] = None,
    perturbation: options.Perturbation = 0.05,
    board: options.Board = "lsc",
    actuators: options.Actuators = "stand-in",
    library: options.Library = "robust",
    bags: options.Bags = Path("bags"),
    console: Annotated[bool, typer.Option("--console", help="Show it in the browser as well, while it runs.")] = False,
    domain: options.Domain = None,
) -> None:
    """Roll the virtual prototype with its twin: board emulator on a pty, bridge, planner and twin as separate processes.

    Every roll is a virtual one. Ctrl-C at any moment holds the struts, closes the bag and ends.

    sixstrut demo
    sixstrut demo --rolls 6 --seed 4 --from-face TO1
    sixstrut demo --real-time --perturbation 0.1
    sixstrut demo --console --real-time --rolls 10
    sixstrut demo --board maestro:crc
    """
    announce(f"{rolls} virtual rolls, some seconds each; Ctrl-C holds the struts, closes the bag and ends")
    from tensegrity_lab.stack.virtual_stack import VirtualRobot
    from tensegrity_lab.studies.demo import Demo

    if real_time is None:
        real_time = len(os.sched_getaffinity(0)) < 2
    pace = 1.0 if real_time else 8.0
    robot = VirtualRobot(from_face, seed, perturbation, pace, board, actuators, library, bags)
    raise typer.Exit(Demo(rolls, robot, console, domain).run())
