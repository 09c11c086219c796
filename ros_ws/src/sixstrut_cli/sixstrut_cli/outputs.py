# SPDX-License-Identifier: Apache-2.0
"""Files that commands write: looked at before anything is computed or asked, so that none of another kind is lost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import typer

COUNTS = "gaits' success counts"
KINDS = {
    "primitive library": "primitives",
    "prototype": "strut_length_m",
    "calibration": "struts",
    COUNTS: "wins",
    "ensemble": "members",
    "climb limits": "steepest_deg",
    "actuator file": "no_load_speed_m_s",
}
"""Kind of a YAML file -> an entry that only this kind has."""

PICTURES = (".png", ".svg", ".pdf")


def output_of(kind: str) -> Callable[[Path | None], Path | None]:
    """A callback for the option of a YAML file that is written: only a file of the same kind may be overwritten."""

    def checked(path: Path | None) -> Path | None:
        if path is not None:
            require_output(path, kind)
        return path

    return checked


def require_output(path: Path, kind: str) -> None:
    """Raises typer.BadParameter: the path is a folder, or a file of another kind."""
    if path.is_dir():
        raise typer.BadParameter(f"{path} is a folder: give the name of a file")
    if path.exists() and path.stat().st_size and (found := kind_of(path)) != kind:
        other = _a(found) if found else "a file of another kind"
        raise typer.BadParameter(f"{path} exists and is {other}, not {_a(kind)}: it is left as it is, give another name")


def kind_of(path: Path) -> str:
    """One of `KINDS`; empty: none of them."""
    from sim_core.errors import SimError
    from sim_core.files.yaml_reader import read_yaml

    try:
        document = read_yaml(path)
    except (SimError, OSError):
        document = None
    kinds = [kind for kind, key in KINDS.items() if isinstance(document, Mapping) and key in document]
    return kinds[0] if kinds else ""


def picture_path(path: Path | None) -> Path | None:
    """A callback for the option of a picture. Raises typer.BadParameter: its name does not end like a picture's."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise typer.BadParameter(f"{path} is no name of a picture: valid ends are {', '.join(PICTURES)}")
    return path


def _a(kind: str) -> str:
    return kind if kind in (COUNTS, "climb limits") else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"
