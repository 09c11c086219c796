# SPDX-License-Identifier: Apache-2.0
"""A session's ledger: a CSV table that only ever grows. A line counts once it is whole and on the disk."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim_core.errors import FileError
from sim_core.files.bounded_reader import read_bytes
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.csv_tables import csv_row
from tensegrity_lab.session_data.ledger_line import ADDED, COLUMNS, Event, Line, Outcome, line_of, text_of
from tensegrity_lab.terminal.leaving import uninterrupted

LEDGER, NEW = "ledger.csv", ".new"
HEADER = csv_row(COLUMNS)
_HEADERS = HEADER, csv_row(name for name in COLUMNS if name not in ADDED)
MOST_BYTES = 512_000_000
"""A million trials have half of it."""


@dataclass(frozen=True)
class Standing:
    """What a ledger says when all of it is read.

    Attributes:
        trials: number -> the trials that count as they stand, in order; void ones too, revoked ones not.
        revoked: numbers of those that do not.
        open: the trial that began and has no end: its session was killed; None: there is none.
        last_number: of any trial; 0 before the first.
    """

    trials: Mapping[int, Line]
    revoked: frozenset[int]
    open: Line | None
    last_number: int

    @property
    def valid(self) -> list[Line]:
        """Successes and failures, in order."""
        return [line for line in self.trials.values() if line.outcome is not Outcome.VOID]

    @property
    def successes(self) -> int:
        """How many of them succeeded."""
        return sum(line.outcome is Outcome.SUCCESS for line in self.valid)

    def done(self) -> set[tuple[str, str, str, int]]:
        """Gaits and chains (see `Line.gait`) that need no trial any more."""
        return {line.gait for line in self.valid}


def standing_of(lines: Iterable[Line]) -> Standing:
    """Read lines in order.

    Raises:
        SessionError: lines contradict each other: a trial ends twice, ends without a beginning, or is revoked twice.
    """
    trials: dict[int, Line] = {}
    revoked: set[int] = set()
    began: Line | None = None
    last = 0
    for line in lines:
        if line.event is Event.BEGIN:
            if began is not None or line.number != last + 1:
                raise SessionError(f"the ledger begins trial {line.number} where {last + 1 if began is None else 'an end'} is due")
            began, last = line, line.number
        elif line.event is Event.TRIAL:
            if began is None or began.number != line.number or line.outcome is Outcome.NONE:
                raise SessionError(f"the ledger ends trial {line.number} as {line.outcome or 'nothing'}, which had not begun")
            trials[line.number], began = line, None
        else:
            if line.number not in trials:
                raise SessionError(f"the ledger revokes trial {line.number}, which does not stand")
            del trials[line.number]
            revoked.add(line.number)
    return Standing(trials, frozenset(revoked), began, last)


def read_lines(path: Path) -> tuple[list[Line], int]:
    """Every whole line of a ledger, and how many are cut short or damaged (a power cut leaves one such line).

    Raises:
        SessionError: it cannot be read, or is not a ledger of this version.
    """
    try:
        head, *rest = read_bytes(path, MOST_BYTES).decode("utf-8", errors="replace").split("\n")
    except FileError as error:
        raise SessionError(str(error)) from error
    except OSError as error:
        raise SessionError(f"cannot read the ledger {path}: {error.strerror}; give the folder of a session") from error
    if head not in _HEADERS:
        raise SessionError(f"{path} is not a ledger of this version: its first line is {head[:60]!r}, not {HEADER[:60]!r}…")
    lines, damaged = [], 0
    for text in rest:
        if not text:
            continue
        try:
            lines.append(line_of(text))
        except SessionError:
            damaged += 1
    return lines, damaged


class Ledger:
    """A ledger to append to.

    Attributes:
        path: the file.
        lines: all whole lines so far.
        damaged: lines that are cut short.
    """

    def __init__(self, folder: Path):
        """Open a session's ledger, or begin it. Raises SessionError, OSError."""
        self.path = folder / LEDGER
        if not self.path.exists():
            write_durably(self.path, HEADER + "\n")
        self.lines, self.damaged = read_lines(self.path)
        with self.path.open(encoding="utf-8") as file:
            self._columns = file.readline().rstrip("\n").split(",")

    def standing(self) -> Standing:
        """What it says. Raises SessionError: it contradicts itself."""
        return standing_of(self.lines)

    def append(self, line: Line) -> None:
        """Add a line; on return it is on the disk. What a power cut left of another stays, and is closed first. Raises OSError."""
        self.append_all([line])

    def append_all(self, lines: Sequence[Line]) -> None:
        """Add lines at once; on return they are on the disk. Raises OSError."""
        with uninterrupted(again=True), self.path.open("r+b") as file:
            at = file.seek(0, os.SEEK_END)
            file.seek(at - 1)
            closing = b"" if file.read(1) == b"\n" else b"\n"
            file.write(closing + "".join(text_of(line, self._columns) + "\n" for line in lines).encode())
            file.flush()
            os.fsync(file.fileno())
            self.lines += lines


def write_durably(path: Path, text: str) -> None:
    """Write a new file, whole or not at all; on return it is on the disk. Raises OSError."""
    new = path.with_name(path.name + NEW)
    with new.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)  # the name is durable only when the folder is
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
