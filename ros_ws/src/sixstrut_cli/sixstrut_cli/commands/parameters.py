"""`sixstrut parameters`: the robot's numbers, with units and sources."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from sim_core.parameters import Entry
from sixstrut_cli.commands.options import PrototypeOption


class Export(StrEnum):
    """What `--export` writes."""

    json = "json"


def command(
    prototype: PrototypeOption = None,
    export: Annotated[
        Export | None,
        typer.Option("--export", help="Everything that another solver needs, member by member, as JSON.", show_default=False),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the export here.", show_default="stdout")] = None,
) -> None:
    """Print the table of the robot's numbers: value, unit, source, meaning.

    sixstrut parameters
    sixstrut parameters --export json -o robot.json
    """
    from sim_core.elements import elements_of
    from sim_core.parameters import Prototype, load_entries

    entries = load_entries(prototype)
    robot = Prototype(**{entry.name: entry.value for entry in entries})
    elements = elements_of(robot)
    if export is Export.json:
        document = {
            "schema": 1,
            "units": "SI; numbering and axes as in the docstring of sim_core.elements.Elements",
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
            output.write_text(text + "\n", encoding="utf-8")
            typer.echo(f"wrote {output}")
        return
    if output is not None:
        raise typer.BadParameter("--output needs --export")
    _print_table(entries)
    typer.echo(f"prototype {robot.hash}, model {elements.hash}; --export json writes masses, points and members one by one")


def _print_table(entries: Iterable[Entry]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title="The robot's parameters")
    for column in ("parameter", "value", "unit", "source", "meaning"):
        table.add_column(column, justify="right" if column == "value" else "left", overflow="fold")
    for entry in entries:
        values = entry.value if isinstance(entry.value, tuple) else (entry.value,)
        unique = values if len(set(values)) > 1 else values[:1]
        table.add_row(entry.name, ", ".join(f"{value:g}" for value in unique), entry.unit, entry.source, entry.note)
    Console().print(table)
