# SPDX-License-Identifier: Apache-2.0
"""`sixstrut console`: the robot in the browser."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce


def command(
    virtual: options.Virtual = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port of the page; 0: any free one.")] = 8080,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
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
    """Show twin, robot, rehearsals and dangers in a browser; roll, travel and judge trials by clicks; stop at any time.

    It joins the stack that runs in this shell's ROS domain (ROS_DOMAIN_ID), or starts one with a virtual prototype. Nothing needs
    the network. It prints the address to open, which holds a secret: whoever has it may command. For the same one at every start,
    put it into SIXSTRUT_TOKEN or a file. A stop button in a page is no emergency stop.

    sixstrut console --virtual
    ROS_DOMAIN_ID=7 sixstrut console --port 8000
    sixstrut console --host 0.0.0.0        # from elsewhere too; not encrypted: use a trusted network
    """
    announce("starting; the address to open comes in some seconds")
    from sim_core.rolling.warm_up import Stage
    from tensegrity_console.access import LOOPBACK, chosen_token, refuse_on_command_line
    from tensegrity_console.web.main import serve
    from tensegrity_lab.stack.virtual_stack import VirtualRobot, running
    from tensegrity_lab.terminal.compile_notice import compile_first

    refuse_on_command_line(token)
    secret = chosen_token(token_file)
    if host not in LOOPBACK:
        typer.echo(f"console: heard on {host}, also from elsewhere, and NOT ENCRYPTED: use a network that you trust")
    with ExitStack() as closing:
        if virtual:
            robot = VirtualRobot(from_face, seed, perturbation, time_scale, board, actuators, library, bags, incline)
            closing.enter_context(running(robot, "console", typer.echo, domain))
        else:
            compile_first(Stage.ROBOT)
        serve(host, port, secret, lambda url: typer.echo(f"console: {url}   (Ctrl-C ends it)"))
