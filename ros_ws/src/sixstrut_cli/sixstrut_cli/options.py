# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, as types of their parameters."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from hardware_bridge.boards.registry import SERVO_BOARD
from sixstrut_cli.outputs import COUNTS, output_of, picture_path

MOST_PERTURBATION = 0.3
"""`sim_core.uncertainty.perturbation_law.MAX_SCALE`, by value: to import it would load numpy for every `--help`."""

MOST_INCLINE_DEG = 20.0
"""`sim_core.uncertainty.perturbation_law.MAX_INCLINE_DEG`, by value as well."""

HIGHEST_DOMAIN = 101
"""`tensegrity_lab.stack.ros_domain.HIGHEST`, by value as well."""

Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
Page = Annotated[bool, typer.Option("--page", help="Write the repository's page in docs/results/.")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder to write to; default: out/ and the command's name.")]
SuccessCounts = Annotated[
    Path | None,
    typer.Option(
        "--odds",
        metavar="FILE",
        help="Write how often, or how likely, every gait works: for planner and route.",
        callback=output_of(COUNTS),
    ),
]
Picture = Annotated[Path | None, typer.Option("--picture", help="Write a PNG here.", callback=picture_path)]

# The model.
Prototype = Annotated[Path | None, typer.Option("--prototype", help="A prototype YAML; default: the nominal robot.")]
Library = Annotated[str, typer.Option("--library", help="A shipped library's name, or a YAML file.")]
Ensemble = Annotated[
    Path | None, typer.Option("--ensemble", metavar="FILE", help="Use robots fitted to trials (`sixstrut fit`) instead.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="A Dask scheduler; default: this machine's cores.")
]

# The virtual prototype and its stack.
Virtual = Annotated[
    bool, typer.Option("--virtual", help="Start a virtual prototype with bridge, planner, traveller and twin as well.")
]
Seed = Annotated[
    int, typer.Option("--seed", min=0, help="Of the virtual prototype: draws its true parameters, and where downhill is.")
]
FromFace = Annotated[str, typer.Option("--from-face", help="Face to start on: TC1..TC8, TO1..TO12.")]
Perturbation = Annotated[
    float,
    typer.Option("--perturbation", min=0.0, max=MOST_PERTURBATION, help="How far the virtual prototype is off, 0.05 for ±5 %."),
]
Incline = Annotated[float, typer.Option("--incline", min=0.0, max=MOST_INCLINE_DEG, help="Of the ground, in degrees.")]
TimeScale = Annotated[float, typer.Option("--time-scale", min=0.01, max=100.0, help="Robot seconds per second.")]
Actuators = Annotated[str, typer.Option("--actuators", help="Of the virtual prototype: ideal, stand-in, or a YAML file.")]
Bags = Annotated[Path, typer.Option("--bags", help="Folder for the bag, and its picture.")]
Domain = Annotated[
    int | None,
    typer.Option("--domain", min=0, max=HIGHEST_DOMAIN, help="ROS domain of the virtual stack; default: one that nobody uses."),
]

# The robot's board.
Board = Annotated[str, typer.Option("--board", help=f"{SERVO_BOARD[0].upper()}{SERVO_BOARD[1:]}.")]
Port = Annotated[str, typer.Option("--port", help="Device or socket://HOST:PORT; default: the virtual prototype's link.")]
Baud = Annotated[int, typer.Option("--baud", min=0, max=1_000_000, help="Rate of the port; 0: the board's usual.")]
Calibration = Annotated[Path | None, typer.Option("--calibration", help="The robot's calibration YAML.")]
SilentBoard = Annotated[bool, typer.Option("--silent-board", help="This board cannot answer; use it all the same.")]

# Servers.
TokenFile = Annotated[
    Path | None,
    typer.Option("--token-file", help="A file (mode 600) with the secret of the address; default: SIXSTRUT_TOKEN, else new."),
]
Token = Annotated[str | None, typer.Option("--token", hidden=True)]
"""No more: everybody sees it in the list of processes."""


def given_or(newest: Callable[[], Path], given: list[Path] | None) -> list[Path]:
    """The paths given; else the newest, which is named on standard error."""
    if given:
        return given
    found = newest()
    typer.echo(f"the newest: {found}", err=True)
    return [found]


def place_of(words: Sequence[str]) -> tuple[float, float]:
    """A place on the floor in m from "X,Y", or from X and Y apart. Raises typer.BadParameter."""
    text = ",".join(word.strip() for word in words)
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise typer.BadParameter(f"{text!r}: valid is a face such as TC1, or a place on the floor in m, such as 1.0,-0.3")
    return x, y
