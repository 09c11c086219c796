# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from hardware_bridge.boards.names import SERVO_BOARD

MOST_PERTURBATION = 0.3
"""`sim_core.uncertainty.distribution.MAX_SCALE`, by value: to import it would load numpy for every `--help`."""

MOST_INCLINE_DEG = 20.0
"""`sim_core.uncertainty.distribution.MAX_INCLINE_DEG`, by value as well."""

HIGHEST_DOMAIN = 101
"""`tensegrity_lab.stack.ros_domain.HIGHEST`, by value as well."""

PrototypeOption = Annotated[
    Path | None, typer.Option("--prototype", help="A prototype YAML; default: the nominal robot.", show_default=False)
]
LibraryOption = Annotated[str, typer.Option("--library", help="A shipped library's name, or a YAML file.")]
VirtualOption = Annotated[
    bool, typer.Option("--virtual", help="Start a virtual prototype with bridge, planner, traveller and twin as well.")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Of the virtual prototype.")]
FromFaceOption = Annotated[str, typer.Option("--from-face", help="Face it starts on: TC1..TC8, TO1..TO12.")]
PerturbationOption = Annotated[
    float, typer.Option("--perturbation", min=0.0, max=MOST_PERTURBATION, help="How far it is off, 0.05 for ±5 %.")
]
InclineOption = Annotated[float, typer.Option("--incline", min=0.0, max=MOST_INCLINE_DEG, help="Of its ground, in degrees.")]
TimeScaleOption = Annotated[float, typer.Option("--time-scale", min=0.01, max=100.0, help="Its robot seconds per second.")]
BoardOption = Annotated[str, typer.Option("--board", help=f"{SERVO_BOARD.capitalize()}.")]
ActuatorsOption = Annotated[str, typer.Option("--actuators", help="Its actuators: ideal, stand-in, or a YAML file.")]
DomainOption = Annotated[
    int | None,
    typer.Option(
        "--domain",
        min=0,
        max=HIGHEST_DOMAIN,
        help="ROS domain of the virtual stack. [default: one that nobody uses]",
        show_default=False,
    ),
]
BagsOption = Annotated[Path, typer.Option("--bags", help="Folder for the bag, with --virtual.")]
TokenFileOption = Annotated[
    Path | None,
    typer.Option(
        "--token-file",
        help="A file (mode 600) with the secret of the address. [default: SIXSTRUT_TOKEN, else new]",
    ),
]
TokenOption = Annotated[str | None, typer.Option("--token", hidden=True)]
"""No more: everybody sees it in the list of processes."""
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]


def announce(words: str) -> None:
    """The first line of a command that loads or computes for a while: for a person at a terminal, not for a script's log."""
    if sys.stderr.isatty():
        typer.echo(words, err=True)


def chosen_sessions(given: list[Path] | None) -> list[Path]:
    """The given ones; else the newest, named on standard error. Raises SessionError: there is none."""
    if given:
        return given
    from tensegrity_lab.session_data.folder import newest_session

    newest = newest_session()
    typer.echo(f"the newest session: {newest}", err=True)
    return [newest]


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


PageOption = Annotated[bool, typer.Option("--page", help="Write the repository's page in docs/results/.")]
OutputOption = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder to write to. [default: out/ and the command's name]", show_default=False),
]


def output_folder(command: str, chosen: Path | None = None) -> Path:
    """Where a command writes: the folder given, else out/COMMAND below the working directory. It is made."""
    folder = chosen or Path("out") / command
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def in_folder(file: Path) -> Path:
    """The file to write, its folder made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    return file


def results_page(name: str) -> Path:
    """A page of the repository that a command writes. Raises typer.BadParameter: there is no repository here."""
    page = Path(os.environ.get("SIXSTRUT_ROOT", ".")) / "docs" / "results" / name
    if not page.parent.is_dir():
        raise typer.BadParameter(
            f"{page.parent} is not there: --page works in the repository; elsewhere use -o", param_hint="--page"
        )
    return page
