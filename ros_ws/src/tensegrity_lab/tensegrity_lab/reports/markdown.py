# SPDX-License-Identifier: Apache-2.0
"""Markdown tables, for every page that a command writes."""

from collections.abc import Iterable, Sequence


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
