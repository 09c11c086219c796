# SPDX-License-Identifier: Apache-2.0
"""docs/results/failures.md, written from what the scenarios saw."""

import re
from collections.abc import Mapping, Sequence

from tensegrity_lab.reports.markdown import table
from tests.failures.runner import Outcome

_HEAD = """# Failures

What can go wrong, what the stack does about it, what you see, and what to do. Each row is a scenario that runs with the real nodes
and a virtual prototype behind a real pseudo-terminal; this page is written by `./sixstrut faults --page` from what was
seen, and a test holds it to the scenarios. Names of folders are left out. No real board, Bluetooth module or robot was there.
"""


def as_markdown(outcomes: Sequence[Outcome]) -> str:
    """The page. Args: outcomes: of all rows, in their order; all must have been survived."""
    rows = []
    for outcome in outcomes:
        row = outcome.scenario
        told = "<br>".join(f"`{without_folders(text)}`" for text in outcome.evidence.told)
        rows.append((row.number, row.failure, row.happens, told, row.remedy))
    lines = [_HEAD, table(("#", "failure", "what happens", "what the operator sees", "what to do"), rows, "lllll")]
    figures = []
    for outcome in outcomes:
        number, evidence = outcome.scenario.number, outcome.evidence
        figures += [(number, name, f"{value:g}") for name, value in evidence.figures.items()]
        if evidence.rows:
            lines += ["", f"## {number}. {outcome.scenario.failure}: by board", "", _by_board(evidence.rows)]
    lines += ["", "## What was measured meanwhile", "", table(("#", "what", "value"), figures, "lll")]
    return "\n".join(lines) + "\n"


def without_folders(text: str) -> str:
    """A text without the folders of the machine that it was seen on; devices keep theirs."""
    return re.sub(r"(?<![\w.])/(?!dev/|proc/|arm\b)(?:[\w.+-]+/)+", "", text)


def _by_board(rows: Mapping[str, Mapping[str, str]]) -> str:
    heads = list(next(iter(rows.values())))
    return table(("board", *heads), [(f"`{board}`", *cells.values()) for board, cells in rows.items()], "l" * (len(heads) + 1))
