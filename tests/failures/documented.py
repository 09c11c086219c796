# SPDX-License-Identifier: Apache-2.0
"""What docs/results/failures.md says, and texts without what differs from run to run."""

import re
from pathlib import Path
from typing import NamedTuple

DOCS_PAGE = Path("docs/results/failures.md")
_CELL = re.compile(r"(?<!\\)\|")
_VOLATILE = (
    (re.compile(r"(?:/[\w.+-]+)+/(?=[\w.+-])"), ""),  # folders
    (re.compile(r"/dev/pts/\d+"), "pts"),
    (re.compile(r"\bv?[0-9a-f]{16,64}\b"), "HASH"),
    (re.compile(r"[-+]?\d+(?:\.\d+)?"), "#"),
)


class PageRow(NamedTuple):
    """A row of the page; `told` are the texts that an operator sees."""

    failure: str
    happens: str
    told: tuple[str, ...]
    remedy: str


def page_rows(text: str) -> dict[int, PageRow]:
    """The rows of a page, by number."""
    rows: dict[int, PageRow] = {}
    for line in text.splitlines():
        cells = [cell.strip().replace("\\|", "|") for cell in _CELL.split(line)[1:-1]]
        if len(cells) == 5 and cells[0].isdigit():
            told = tuple(part.strip("`") for part in cells[3].split("<br>"))
            rows[int(cells[0])] = PageRow(cells[1], cells[2], told, cells[4])
    return rows


def shape_of(text: str) -> str:
    """A text without what differs from run to run: folders, hashes and numbers."""
    for pattern, instead in _VOLATILE:
        text = pattern.sub(instead, text)
    return text
