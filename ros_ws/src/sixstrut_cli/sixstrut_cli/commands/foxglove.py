"""`sixstrut foxglove`: the live stack for the Foxglove app."""

from __future__ import annotations

import importlib.util
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.commands.options import MOST_INCLINE_DEG, MOST_PERTURBATION, LibraryOption


def command(
    virtual: Annotated[
        bool, typer.Option("--virtual", help="Start a virtual prototype with bridge, planner, traveller and twin as well.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port on this machine; 0: any free one.")] = 8765,
    commands: Annotated[bool, typer.Option("--commands", help="Also take goals, arm, disarm and reset; else only stop.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the virtual prototype.")] = 1,
    from_face: Annotated[str, typer.Option("--from-face", help="Face it starts on: TC1..TC8, TO1..TO12.")] = "TC6",
    perturbation: Annotated[float, typer.Option(min=0.0, max=MOST_PERTURBATION, help="How far it is off, 0.05 for ±5 %.")] = 0.05,
    incline: Annotated[float, typer.Option(min=0.0, max=MOST_INCLINE_DEG, help="Of its ground, in degrees.")] = 0.0,
    time_scale: Annotated[float, typer.Option(min=0.01, max=100.0, help="Its robot seconds per second.")] = 2.0,
    board: Annotated[str, typer.Option(help="Its servo board: lsc, ssc32, maestro, maestro:crc.")] = "lsc",
    actuators: Annotated[str, typer.Option(help="Its actuators: ideal, stand-in, or a YAML file.")] = "stand-in",
    library: LibraryOption = "robust",
    bags: Annotated[Path, typer.Option(help="Folder for the bag, with --virtual.")] = Path("bags"),
) -> None:
    """Serve the stack to the Foxglove app where ROS's foxglove_bridge is not installed: every topic, and a stop button.

    It joins the stack that runs in this shell's ROS domain (ROS_DOMAIN_ID), or starts one with a virtual prototype. It listens on
    this machine only, and knows no password: any program here, also a page in a browser, can connect. So goals, arm, disarm and
    reset are taken only with --commands. A stop button in an app is no emergency stop.

    sixstrut foxglove --virtual --commands
    ROS_DOMAIN_ID=7 sixstrut foxglove --port 8766
    """
    if importlib.util.find_spec("foxglove") is None:
        from sixstrut_cli.errors import StackError

        raise StackError("the package foxglove-sdk is not installed: pip install it, or use ROS's own foxglove_bridge")
    from sixstrut_cli.foxglove_server import FoxgloveServer, layout, wait_for_end
    from sixstrut_cli.virtual_stack import VirtualRobot, running

    with ExitStack() as closing:
        processes = None
        if virtual:
            robot = VirtualRobot(from_face, seed, perturbation, time_scale, board, actuators, library, bags, incline)
            processes = closing.enter_context(running(robot, "foxglove", typer.echo))
        server = FoxgloveServer(port, commands)
        closing.callback(server.close)
        typer.echo(f"Foxglove: open the connection {server.url} and the layout {layout()}   (Ctrl-C ends it)")
        wait_for_end(processes)
