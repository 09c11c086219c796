"""`sixstrut console`: the robot in the browser."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.commands.options import (
    ActuatorsOption,
    BagsOption,
    BoardOption,
    DomainOption,
    FromFaceOption,
    InclineOption,
    LibraryOption,
    PerturbationOption,
    SeedOption,
    TimeScaleOption,
    VirtualOption,
)


def command(
    virtual: VirtualOption = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port of the page; 0: any free one.")] = 8080,
    host: Annotated[str, typer.Option(help="Address to listen on; other than loopback only with a token.")] = "127.0.0.1",
    token: Annotated[str, typer.Option(help="What a browser must know. [default: none on loopback, else a new one]")] = "",
    seed: SeedOption = 1,
    from_face: FromFaceOption = "TC6",
    perturbation: PerturbationOption = 0.05,
    incline: InclineOption = 0.0,
    time_scale: TimeScaleOption = 2.0,
    board: BoardOption = "lsc",
    actuators: ActuatorsOption = "stand-in",
    library: LibraryOption = "robust",
    bags: BagsOption = Path("bags"),
    domain: DomainOption = None,
) -> None:
    """Show twin, robot, odds and dangers in a browser; roll, travel and judge trials by clicks; stop at any time.

    It joins the stack that runs in this shell's ROS domain (ROS_DOMAIN_ID), or starts one with a virtual prototype. Nothing needs
    the network. A stop button in a page is no emergency stop.

    sixstrut console --virtual
    ROS_DOMAIN_ID=7 sixstrut console --port 8000
    sixstrut console --host 0.0.0.0        # prints an address with a token; use a trusted network, it is not encrypted
    """
    from sim_core.warm_up import Stage
    from sixstrut_cli.compiling import compile_first
    from sixstrut_cli.console.running import serve
    from sixstrut_cli.console.server import LOOPBACK, new_token, require_token
    from sixstrut_cli.virtual_stack import VirtualRobot, running

    if token:
        require_token(token)
    elif host not in LOOPBACK:
        token = new_token()
    with ExitStack() as closing:
        if virtual:
            robot = VirtualRobot(from_face, seed, perturbation, time_scale, board, actuators, library, bags, incline)
            closing.enter_context(running(robot, "console", typer.echo, domain))
        else:
            compile_first(Stage.ROBOT)
        serve(host, port, token, lambda url: typer.echo(f"console: {url}   (Ctrl-C ends it)"))
