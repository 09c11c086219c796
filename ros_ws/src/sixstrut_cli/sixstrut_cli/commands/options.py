"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

MOST_PERTURBATION = 0.3
"""`sim_core.perturbation.MAX_SCALE`, by value: to import it would load numpy for every `--help`."""

PrototypeOption = Annotated[
    Path | None, typer.Option("--prototype", help="A prototype YAML; default: the nominal robot.", show_default=False)
]
LibraryOption = Annotated[str, typer.Option("--library", help="A shipped library's name, or a YAML file.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
