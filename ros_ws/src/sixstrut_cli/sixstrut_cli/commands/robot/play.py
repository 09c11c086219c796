# SPDX-License-Identifier: Apache-2.0
"""`sixstrut play`: a bag into ROS, for a twin and viewers."""

import os
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.outputs import announce, console


def command(
    bag: Annotated[Path, typer.Argument(help="A bag: a folder of the bridge or of rosbag2, or an .mcap file.")],
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="Recorded seconds per second.")] = 1.0,
    twin: Annotated[bool, typer.Option("--twin/--no-twin", help="Start a twin that follows it.")] = True,
) -> None:
    """Play what the bridge told then into ROS, under its live names, with a twin that follows: for RViz, Foxglove, PlotJuggler.

    For machines without rosbag2. No command is played, and nothing at all while a bridge runs in this ROS domain.

    sixstrut play bags/example
    sixstrut play bags/example --rate 4 --no-twin
    """
    announce(f"reading {bag}" + ("; a twin that follows is started" if twin else ""))
    from rich.progress import Progress

    from sim_core.rolling.warm_up import Stage
    from tensegrity_lab.bags.play import play
    from tensegrity_lab.terminal.compile_notice import compile_first

    if twin:
        compile_first(Stage.ROBOT)
    where = f"ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}, topics bridge/… and twin/…"
    with Progress(transient=True, console=console()) as bar:
        task = bar.add_task("playing", total=None)

        def told(done_s: float, total_s: float) -> None:
            if bar.tasks[0].total is None:
                speed = f"{total_s:.0f} s at {rate:g} times their speed"
                bar.console.print(f"playing {speed} into {where}")
                bar.console.print("look with RViz, or sixstrut foxglove; Ctrl-C ends it")
            bar.update(task, completed=done_s, total=total_s)

        played = play(bag, rate, twin, told)
    typer.echo(f"played {played.messages} messages")
    if played.twin is not None:
        end = played.twin
        face = end.face or "no face"
        typer.echo(f"the twin stands on {face}: state {end.digest} at step {end.step}, model {end.model_hash}")
