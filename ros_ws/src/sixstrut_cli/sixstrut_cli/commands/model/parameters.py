# SPDX-License-Identifier: Apache-2.0
"""`sixstrut parameters`: the robot's numbers, with units and sources."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from sim_core.gaits.library import load_library
from sim_core.structure.elements import elements_of
from sim_core.structure.parameter_file import Entry
from sim_core.structure.parameters import FILE, Prototype, load_prototype
from sim_core.studies.sensitivity import EACH, STORED, Influence, influences, stored_influences, text_of
from sim_core.twin.model_versions import label_of
from sixstrut_cli import options
from sixstrut_cli.outputs import announce, in_folder, picture_path, writable, wrote


def command(
    prototype: options.Prototype = None,
    export: Annotated[
        Literal["json"] | None, typer.Option("--export", help="Everything that another solver needs, member by member, as JSON.")
    ] = None,
    sensitivity: Annotated[bool, typer.Option("--sensitivity", help="Compute what each number influences (some minutes).")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the export here.", show_default="stdout", callback=writable)
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the robot, its parts named, as PNG.", callback=picture_path)
    ] = None,
) -> None:
    """Print the table of the robot's numbers: value, unit, source, what it influences, meaning.

    The column "flips": share of policies near the library whose outcome changes when this number alone is 10 % off.

    sixstrut parameters
    sixstrut parameters --prototype my_prototype.yaml --sensitivity
    sixstrut parameters --export json -o robot.json
    sixstrut parameters --picture robot.png
    """
    if picture is not None:
        from tensegrity_lab.reports.words_picture import words_picture

        if words_picture(picture, load_prototype(prototype)) is None:
            raise typer.Exit(1)
        wrote(picture)
        return
    entries = FILE.load(prototype)
    robot = Prototype(**{entry.name: entry.value for entry in entries})
    elements = elements_of(robot)
    if export == "json":
        document = {
            "schema": 1,
            "units": "SI; numbering and axes as in the docstring of sim_core.structure.elements.Elements",
            "prototype_hash": robot.hash,
            "model_hash": elements.hash,
            "prototype": asdict(robot),
            "sources": {entry.name: entry.source for entry in entries},
            "elements": elements.as_dict(),
        }
        text = json.dumps(document, indent=1)
        if output is None:
            typer.echo(text)
        else:
            in_folder(output).write_text(text + "\n", encoding="utf-8")
            wrote(output)
        return
    if output is not None:
        raise typer.BadParameter("--output needs --export")
    _print_table(entries, _computed(robot, prototype is None) if sensitivity else stored_influences(robot))
    typer.echo(
        f"prototype {robot.hash}, model {label_of(elements.hash)}; --export json writes masses, points and members one by one"
    )


def _computed(robot: Prototype, keep: bool) -> dict[str, Influence]:
    """Compute the influences, with a progress bar; those of the nominal robot are kept beside its parameters."""
    from tensegrity_lab.terminal.progress import bars

    announce("rolling policies with each number 10 % off, some minutes; Ctrl-C leaves at any time")
    library = load_library("robust")
    with bars("rolls", "nothing was written") as bar:
        found = influences(robot, library, report=bar("varying one number at a time"))
    if keep:
        try:
            STORED.write_text(text_of(robot, library, EACH, found), encoding="utf-8")
        except OSError as error:
            typer.echo(f"warning: not kept for the next time: {error}", err=True)
    return found


def _print_table(entries: Iterable[Entry], found: dict[str, Influence] | None) -> None:
    """One line a number, its meaning indented below: readable at any width."""
    from rich.console import Console
    from rich.padding import Padding

    console = Console(highlight=False)
    console.print(f"{'parameter':<34}{'value':>9} {'unit':<8}{'source':<11}{'flips':>7}", style="bold", soft_wrap=True)
    for entry in entries:
        values = entry.value if isinstance(entry.value, tuple) else (entry.value,)
        unique = values if len(set(values)) > 1 else values[:1]
        shown = ", ".join(f"{value:g}" for value in unique)
        line = f"{entry.name:<34}{shown:>9} {entry.unit:<8}{entry.source:<11}{_flips(found, entry.name):>7}"
        console.print(line, soft_wrap=True)
        if entry.note:
            console.print(Padding(entry.note, (0, 0, 0, 4)), style="dim")
    if found is None:
        typer.echo("flips: not computed for these numbers; --sensitivity does it")


def _flips(found: dict[str, Influence] | None, name: str) -> str:
    share = found[name].flips if found and name in found else None
    return "" if share is None else f"{100 * share:.1f} %"
