# SPDX-License-Identifier: Apache-2.0
"""Cells of CSV tables, for whoever opens them in a spreadsheet: text that would be run as a formula is marked as text."""

from __future__ import annotations

import re

_NUMBER = r"[-+]?[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?"
_NUMBERS = re.compile(f"{_NUMBER}( {_NUMBER})*")
"""One or several: -5, +1e-3, "-12 0 7"."""
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_MARKED = re.compile(r"'+[=+\-@\t\r]")


def cell_of(value: object) -> object:
    """What to write for a value: text that begins a formula gets an apostrophe; control characters and blanks become one blank."""
    if not isinstance(value, str):
        return value
    text = " ".join("".join(character if character.isprintable() else " " for character in value).split())
    return f"'{text}" if _FORMULA.match(text) and not _NUMBERS.fullmatch(text) else text


def value_of(cell: str) -> str:
    """The text of a cell that `cell_of` made."""
    return cell[1:] if _MARKED.match(cell) else cell
