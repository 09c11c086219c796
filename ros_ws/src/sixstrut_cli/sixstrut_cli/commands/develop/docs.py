# SPDX-License-Identifier: Apache-2.0
"""`sixstrut docs`: the reference pages from the code, and the documentation as a site."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.outputs import announce, import_checkout, output_folder, repository, wrote

EXIT_DIFFERENT = 4


def command(
    check: Annotated[bool, typer.Option("--check", help="Write nothing: compare the reference pages with the code.")] = False,
    pages_only: Annotated[bool, typer.Option("--pages-only", help="Write the reference pages, build no site.")] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the site; default: out/site.")] = None,
) -> None:
    """Write docs/reference/ from the code, and build the site of docs/, which needs no network when it is read.

    Exit code 0: done; 4, with --check: a page is not what the code says.

    sixstrut docs
    sixstrut docs --check
    """
    import_checkout("docs")
    from docs.from_code import pages

    folder = repository("docs/reference")
    root = folder.parents[1]
    texts = {folder / name: make(root) for name, make in pages().items()}
    different = [path for path, text in texts.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    if check:
        for path in different:
            typer.echo(f"{path} is not what the code says: run ./sixstrut docs and commit it", err=True)
        raise typer.Exit(EXIT_DIFFERENT if different else 0)
    for path in different:
        path.write_text(texts[path], encoding="utf-8")
        wrote(path)
    if not different:
        typer.echo("docs/reference/ is as the code says")
    if not pages_only:
        _build(root / "docs", output_folder("site", output))


def _build(source: Path, site: Path) -> None:
    """The site, strictly: a warning is an error."""
    announce("building the site, half a minute")
    words = ["-W", "-n", "--keep-going", "-q", "-b", "html", "-d", str(site.parent / f".{site.name}_trees"), str(source), str(site)]
    done = subprocess.run([sys.executable, "-m", "sphinx", *words], check=False)
    if done.returncode != 0:
        raise typer.Exit(1)
    wrote(site / "index.html")
