# SPDX-License-Identifier: Apache-2.0
"""`sixstrut foxglove`: the live stack for the Foxglove app."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce


def command(
    virtual: options.Virtual = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port on this machine; 0: any free one.")] = 8765,
    commands: Annotated[bool, typer.Option("--commands", help="Also take goals, arm, disarm and reset; else only stop.")] = False,
    origin: Annotated[list[str] | None, typer.Option(help="A web page that may connect beside Foxglove's own; repeatable.")] = None,
    token_file: options.TokenFile = None,
    token: options.Token = None,
    seed: options.Seed = 1,
    from_face: options.FromFace = "TC6",
    perturbation: options.Perturbation = 0.05,
    incline: options.Incline = 0.0,
    time_scale: options.TimeScale = 2.0,
    board: options.Board = "lsc",
    actuators: options.Actuators = "stand-in",
    library: options.Library = "robust",
    bags: options.Bags = Path("bags"),
    domain: options.Domain = None,
) -> None:
    """Serve the stack to the Foxglove app where ROS's foxglove_bridge is not installed: every topic, and a stop button.

    It joins the stack that runs in this shell's ROS domain (ROS_DOMAIN_ID), or starts one with a virtual prototype. It listens on
    this machine only. The address that it prints holds a secret: who has it may look and stop, and with --commands also send goals,
    arm, disarm and reset. For the same one at every start, put it into SIXSTRUT_TOKEN or a file. Pages of other origins than
    Foxglove's are let in by --origin only. A stop button in an app is no emergency stop.

    sixstrut foxglove --virtual --commands
    ROS_DOMAIN_ID=7 sixstrut foxglove --port 8766 --origin http://localhost:8080
    """
    announce("starting; the address to open comes in some seconds")
    from tensegrity_console.access import chosen_token, refuse_on_command_line
    from tensegrity_console.foxglove.foxglove_server import FoxgloveServer, layout, wait_for_end
    from tensegrity_lab.stack.virtual_stack import VirtualRobot, running

    refuse_on_command_line(token)
    secret = chosen_token(token_file)
    with ExitStack() as closing:
        processes = None
        if virtual:
            robot = VirtualRobot(from_face, seed, perturbation, time_scale, board, actuators, library, bags, incline)
            processes, _ = closing.enter_context(running(robot, "foxglove", typer.echo, domain))
        server = FoxgloveServer(port, commands, secret, tuple(origin or ()))
        closing.callback(server.close)
        typer.echo(f"Foxglove: open the connection {server.url} and the layout {layout()}   (Ctrl-C ends it)")
        wait_for_end(processes)
