# SPDX-License-Identifier: Apache-2.0
"""What commands say and write. A file is looked at before anything is computed or asked, so that none of another kind is lost."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console

COUNTS = "gaits' success counts"
KINDS = {
    "primitive library": "primitives",
    "prototype": "strut_length_m",
    "mounting": "off_deg",
    "calibration": "struts",
    COUNTS: "wins",
    "ensemble": "members",
    "climb limits": "steepest_deg",
    "actuator file": "no_load_speed_m_s",
}
"""Kind of a YAML file -> an entry that only this kind has."""
XML_KINDS = {"URDF file": b"<robot", "MJCF file": b"<mujoco"}
"""Kind of an XML file -> how its root begins."""

PICTURES = (".png", ".svg", ".pdf")


def say(text: str, err: bool = False) -> None:
    """Lines for people: at a terminal they break between words."""
    if (sys.stderr if err else sys.stdout).isatty():
        room = shutil.get_terminal_size().columns - 1
        wrapper = textwrap.TextWrapper(room, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
        text = "\n".join(map(wrapper.fill, text.split("\n")))
    typer.echo(text, err=err)


def console(err: bool = True) -> Console:
    """For people as well: at a terminal its lines break between words."""
    from rich.console import Console

    return Console(stderr=err, highlight=False, soft_wrap=not (sys.stderr if err else sys.stdout).isatty())


def announce(text: str) -> None:
    """The first line of a command that loads or computes for a while: for a person at a terminal, not for a script's log."""
    if sys.stderr.isatty():
        say(text, err=True)


def wrote(*paths: Path | None, err: bool = False) -> None:
    """Says where files are, in full."""
    for path in filter(None, paths):
        typer.echo(f"wrote {path.resolve()}", err=err)


def output_folder(command: str, chosen: Path | None = None) -> Path:
    """Where a command writes: the folder given, else out/COMMAND below the working directory. It is made.

    Raises typer.BadParameter: it cannot be written. To be called before anything is computed.
    """
    folder = chosen or Path("out") / command
    require_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def require_folder(folder: Path) -> None:
    """Raises typer.BadParameter: nothing can be written there."""
    from sim_core.files.places import folder_problem

    if problem := folder_problem(folder):
        raise typer.BadParameter(f"{problem}: choose another folder, or start the command in one of yours")


def writable_folder(folder: Path | None) -> Path | None:
    """A callback for the option of a folder. Raises typer.BadParameter: nothing can be written there."""
    if folder is not None:
        require_folder(folder)
    return folder


def in_folder(file: Path) -> Path:
    """The file to write, its folder made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    return file


def writable(path: Path | None) -> Path | None:
    """A callback for the option of a file that is written. Raises typer.BadParameter: it cannot be."""
    if path is not None:
        require_folder(path.parent)
        if path.is_dir():
            raise typer.BadParameter(f"{path} is a folder: give the name of a file")
        if path.exists() and not os.access(path, os.W_OK):
            raise typer.BadParameter(f"{path} is write-protected: give another name")
    return path


def repository(folder: str) -> Path:
    """A folder of the repository. Raises typer.BadParameter: there is no repository here."""
    path = Path(os.environ.get("SIXSTRUT_ROOT", ".")) / folder
    if not path.is_dir():
        raise typer.BadParameter(f"{path} is not there: this works in the repository, with its ./sixstrut")
    return path


def import_checkout(part: str = "tests") -> None:
    """Make importable what is not installed: failures, benchmarks, validation, docs. Raises typer.BadParameter: no repository."""
    sys.path.insert(0, str(repository(part).parent))


def results_page(name: str) -> Path:
    """A page of the repository that a command writes. Raises typer.BadParameter: no repository is here, or it is not writable."""
    folder = repository("docs/results")
    require_folder(folder)
    return folder / name


def output_of(kind: str) -> Callable[[Path | None], Path | None]:
    """A callback for the option of a YAML file that is written: only a file of the same kind may be overwritten."""

    def checked(path: Path | None) -> Path | None:
        if path is not None:
            require_output(path, kind)
        return path

    return checked


def require_output(path: Path, kind: str) -> None:
    """Raises typer.BadParameter: the path cannot be written, or is a file of another kind."""
    writable(path)
    if path.exists() and path.stat().st_size and (found := kind_of(path)) != kind:
        other = _a(found) if found else "a file of another kind"
        raise typer.BadParameter(f"{path} exists and is {other}, not {_a(kind)}: it is left as it is, give another name")


def kind_of(path: Path) -> str:
    """One of `KINDS` or `XML_KINDS`; empty: none of them."""
    from sim_core.errors import SimError
    from sim_core.files.yaml_reader import read_yaml

    with path.open("rb") as file:
        head = file.read(1000)
    if head.startswith((b"<?xml", *XML_KINDS.values())):
        return next((kind for kind, root in XML_KINDS.items() if root in head), "")
    try:
        document = read_yaml(path)
    except (SimError, OSError):
        document = None
    kinds = [kind for kind, key in KINDS.items() if isinstance(document, Mapping) and key in document]
    return kinds[0] if kinds else ""


def picture_path(path: Path | None) -> Path | None:
    """A callback for the option of a picture. Raises typer.BadParameter: it cannot be written, or is not called like one."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise typer.BadParameter(f"{path} is no name of a picture: valid ends are {', '.join(PICTURES)}")
    return writable(path)


def _a(kind: str) -> str:
    return kind if kind in (COUNTS, "climb limits") else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"
