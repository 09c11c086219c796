"""Options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

MOST_PERTURBATION = 0.3
"""`sim_core.perturbation.MAX_SCALE`, by value: to import it would load numpy for every `--help`."""

MOST_INCLINE_DEG = 20.0
"""`sim_core.uncertainty.MAX_INCLINE_DEG`, by value as well."""

PrototypeOption = Annotated[
    Path | None, typer.Option("--prototype", help="A prototype YAML; default: the nominal robot.", show_default=False)
]
LibraryOption = Annotated[str, typer.Option("--library", help="A shipped library's name, or a YAML file.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]


def place_of(text: str) -> tuple[float, float]:
    """A place on the floor from "X,Y" in m. Raises typer.BadParameter."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise typer.BadParameter(f"{text!r}: valid is a face such as TC1, or a place on the floor in m, such as 1.0,0.3")
    return x, y
