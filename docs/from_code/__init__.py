# SPDX-License-Identifier: Apache-2.0
"""The reference part of the documentation, from the code: commands, ROS interfaces, parameters, file formats.

A page is a function of the code alone, so a test can hold the committed pages to it (`./sixstrut docs --check`).
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from tensegrity_lab.reports import markdown

NOTE = "*This page is written by `./sixstrut docs` from the code; do not edit it.*"


def pages() -> dict[str, Callable[[Path], str]]:
    """Name of each page -> what makes its text from the repository's root."""
    from docs.from_code import commands, file_formats, interfaces, parameters

    return {
        "commands.md": commands.page,
        "interfaces.md": interfaces.page,
        "parameters.md": parameters.page,
        "file_formats.md": file_formats.page,
    }


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a Markdown table, all columns to the left."""
    return markdown.table(head, rows, "l" * len(head)).splitlines()
