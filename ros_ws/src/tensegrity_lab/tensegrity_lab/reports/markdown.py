# SPDX-License-Identifier: Apache-2.0
"""Markdown tables, for every page that a command writes."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from sim_core.errors import SimError


def table(head: Sequence[str], rows: Iterable[Sequence[object]], columns: str = "") -> str:
    """A table.

    Args:
        head: names of the columns.
        rows: of cells, as many as the head has.
        columns: a letter each, l or r; default: all but the first go right.
    """
    sides = columns or "l" + "r" * (len(head) - 1)
    lines = ["|" + "|".join("---" if side == "l" else "--:" for side in sides) + "|"]
    lines += ["| " + " | ".join(map(cell, row)) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(head) + " |", *lines])


def cell(value: object) -> str:
    """What a cell holds, in one line and without an end of the cell in it."""
    return str(value).replace("|", "\\|").replace("\n", " ")


def write_into(page: Path, name: str, text: str) -> None:
    """Put text between the page's markers of that name. Raises SimError if it has none."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    try:
        old = page.read_text(encoding="utf-8")
    except OSError as error:
        raise SimError(f"cannot read page {page}: {error.strerror}") from error
    pattern = re.compile(f"{begin}.*?{end}", re.DOTALL)
    if not pattern.search(old):
        raise SimError(f"{page} has no place for the table: valid is a page with {begin} and {end}")
    page.write_text(pattern.sub(lambda _: f"{begin}\n{text}\n{end}", old), encoding="utf-8")
