# SPDX-License-Identifier: Apache-2.0
"""CSV tables: records to rows and back, safe for whoever opens them in a spreadsheet.

Text that a spreadsheet would run as a formula gets an apostrophe.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from sim_core.errors import brief
from sim_core.printable import printable
from tensegrity_lab.errors import SessionError

_NUMBER = r"[-+]?[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?"
_NUMBERS = re.compile(f"{_NUMBER}( {_NUMBER})*")
"""One or several: -5, +1e-3, "-12 0 7"."""
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_MARKED = re.compile(r"'+[=+\-@\t\r]")
Record = TypeVar("Record")
_types: Any = cache(get_type_hints)
_parameters: Any = cache(lambda kind: signature(kind).parameters)


def cells_of(record: object) -> dict[str, str]:
    """The cells of a dataclass or named tuple, by field."""
    return {name: _cell(getattr(record, name)) for name in _types(type(record))}


def csv_row(values: Iterable[object]) -> str:
    """A row of a table, without its end; a cell never has more than one line."""
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow(map(_cell, values))
    return out.getvalue()


def write_table(path: Path, rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows with the same keys, which make the first line; the path. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        for number, row in enumerate(rows):
            if number == 0:
                file.write(csv_row(row) + "\n")
            file.write(csv_row(row.values()) + "\n")
    return path


def record_of(kind: type[Record], cells: Mapping[str, str]) -> Record:
    """The dataclass or named tuple that `csv_row` wrote; what tables of before did not have is left at its default.

    Raises:
        SessionError: a cell is missing or makes no sense.
    """
    values = {}
    for name, wanted in _types(kind).items():
        if name not in cells and _parameters(kind)[name].default is not Parameter.empty:
            continue
        try:
            values[name] = _parsed(wanted, _unmarked(cells[name]))
        except (KeyError, TypeError, ValueError) as error:
            raise SessionError(f"column {name} of a trial is {brief(cells.get(name))}: {printable(error, 80)}") from error
    return kind(**values)


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(float(value))
    text = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    text = " ".join("".join(character if character.isprintable() else " " for character in text).split())
    return f"'{text}" if _FORMULA.match(text) and not _NUMBERS.fullmatch(text) else text


def _unmarked(cell: str) -> str:
    return cell[1:] if _MARKED.match(cell) else cell


def _parsed(kind: Any, text: str) -> object:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise ValueError("valid is true or false")
        return text.lower() == "true"
    if kind is float:
        return float(text) if text else math.nan
    if get_origin(kind) is tuple:
        return tuple(map(get_args(kind)[0], text.split()))
    return kind(text)
