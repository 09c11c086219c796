# SPDX-License-Identifier: Apache-2.0
"""docs/results/failures.md: written from what the scenarios saw, and read back by the tests."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tensegrity_lab.failures.runner import Outcome

DOCS_PAGE = Path("docs/results/failures.md")

_HEAD = """# Failures

What can go wrong, what the stack does about it, what you see, and what to do. Each row is a scenario that runs with the real nodes
and a virtual prototype behind a real pseudo-terminal; this page is written by `./sixstrut faults --page` from what was
seen, and a test holds it to the scenarios. Names of folders are left out. No real board, Bluetooth module or robot was there.
"""

_CELL = re.compile(r"(?<!\\)\|")


class PageRow(NamedTuple):
    """A row of the page; `told` are the texts that an operator sees."""

    failure: str
    happens: str
    told: tuple[str, ...]
    remedy: str


def as_markdown(outcomes: Sequence[Outcome]) -> str:
    """The page. Args: outcomes: of all rows, in their order; all must have been survived."""
    lines = [_HEAD, "| # | failure | what happens | what the operator sees | what to do |", "|---|---|---|---|---|"]
    for outcome in outcomes:
        row = outcome.scenario
        told = "<br>".join(f"`{_cell(without_folders(text))}`" for text in outcome.evidence.told)
        lines.append(f"| {row.number} | {_cell(row.failure)} | {_cell(row.happens)} | {told} | {_cell(row.remedy)} |")
    for outcome in outcomes:
        if outcome.evidence.rows:
            lines += ["", f"## {outcome.scenario.number}. {outcome.scenario.failure}: by board", "", *_table(outcome.evidence.rows)]
    figures = [(outcome.scenario.number, key, value) for outcome in outcomes for key, value in outcome.evidence.figures.items()]
    lines += ["", "## What was measured meanwhile", "", "| # | what | value |", "|---|---|---|"]
    lines += [f"| {number} | {_cell(key)} | {value:g} |" for number, key, value in figures]
    return "\n".join(lines) + "\n"


def page_rows(text: str) -> dict[int, PageRow]:
    """The rows of a page, by number."""
    rows: dict[int, PageRow] = {}
    for line in text.splitlines():
        cells = [cell.strip().replace("\\|", "|") for cell in _CELL.split(line)[1:-1]]
        if len(cells) == 5 and cells[0].isdigit():
            told = tuple(part.strip("`") for part in cells[3].split("<br>"))
            rows[int(cells[0])] = PageRow(cells[1], cells[2], told, cells[4])
    return rows


def without_folders(text: str) -> str:
    """A text without the folders of the machine that it was seen on; devices keep theirs."""
    return re.sub(r"(?<![\w.])/(?!dev/|proc/|arm\b)(?:[\w.+-]+/)+", "", text)


def _table(rows: Mapping[str, Mapping[str, str]]) -> list[str]:
    heads = list(next(iter(rows.values())))
    lines = [f"| board | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    return lines + [f"| `{board}` | {' | '.join(cells.values())} |" for board, cells in rows.items()]


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
