# SPDX-License-Identifier: Apache-2.0
"""One line of a session's ledger: a trial that begins, its outcome, or the revocation of one. Its columns, to and from text."""

import csv
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from enum import StrEnum

from sim_core.errors import brief
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.csv_tables import csv_row, record_of


class Event(StrEnum):
    """What a line says."""

    BEGIN = "begin"
    TRIAL = "trial"
    REVOKE = "revoke"


class Outcome(StrEnum):
    """How a trial ended. Void is not failure: nothing was learnt of the gait, and it is tried again."""

    NONE = ""
    SUCCESS = "success"
    FAILURE = "failure"
    VOID = "void"


@dataclass(frozen=True)
class Line:
    """A line of the ledger. Every line of a trial has all that is known then; see TrialRecord.msg for each field.

    Attributes:
        event: what it says.
        number: of the trial in its session, from 1; a revocation has the number of what it revokes.
        recorded, began: when the line was written, and when the roll was asked for: UTC, ISO 8601, microseconds.
        session, experimenter, robot: who.
        virtual_robot: a virtual trial.
        library, library_hash, primitive, roll_class, source, target, repeat, proper, policy_mm: what; of a chain cycle, first face,
            last face, and of its first roll class, `proper` and strokes.
        odds: predicted probability of success; NaN: nobody knows.
        predicted: the nominal model says that it is feasible.
        outcome, reason, observed_face, faces: how it ended; faces in order, the source first.
        robot_s: robot time, first to last move (s); NaN: it did not end.
        wall_s: from `began` to the outcome (s).
        battery_v: servo supply (V); NaN: the board does not tell.
        faults: what the bridge complained of.
        bag, bag_offset_s: its name, and where in it the roll begins (s after its first message).
        chain: its faces, such as TC6-TO5-TC3; empty: it is one roll.
        rolls: how many came onto their face.
    """

    event: Event
    number: int
    recorded: str
    session: str
    experimenter: str
    robot: str
    virtual_robot: bool
    library: str
    library_hash: str
    primitive: str
    roll_class: str
    source: str
    target: str
    repeat: int
    proper: bool
    policy_mm: tuple[int, ...]
    odds: float
    predicted: bool
    outcome: Outcome = Outcome.NONE
    reason: str = ""
    observed_face: str = ""
    faces: tuple[str, ...] = ()
    began: str = ""
    robot_s: float = math.nan
    wall_s: float = math.nan
    battery_v: float = math.nan
    faults: str = ""
    bag: str = ""
    bag_offset_s: float = math.nan
    chain: str = ""
    rolls: int = 0

    @property
    def gait(self) -> tuple[str, str, str, int]:
        """What was tried: primitive, source, target or chain, repetition."""
        return self.primitive, self.source, self.chain or self.target, self.repeat

    @property
    def name(self) -> str:
        """For people: primitive and faces."""
        return gait_name(self.primitive, self.source, self.target, self.chain)

    @property
    def wanted(self) -> int:
        """How many rolls it asks for."""
        return self.chain.count("-") or 1

    @property
    def ended(self) -> str:
        """Outcome for people; of a chain with the rolls it made."""
        return f"{self.outcome}, {self.rolls} of {self.wanted} rolls" if self.chain else str(self.outcome)


COLUMNS = (*(field.name for field in fields(Line)), "check")
"""Of the ledger and of the report's tables; `check` is the CRC-32 of the line before it."""
ADDED = ("chain", "rolls")
"""Ledgers of before do not have these columns."""


def gait_name(primitive: str, source: str, target: str, chain: str = "") -> str:
    """A gait or a chain for people, such as "P1 TC6→TO5"."""
    return f"{primitive} {(chain or f'{source}-{target}').replace('-', '→')}"


def utc_text(time_ns: int) -> str:
    """A ROS time as the ledger writes it. `time_ns`: since 1970."""
    return datetime.fromtimestamp(time_ns // 1000 / 1e6, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def utc_ns(text: str) -> int:
    """The time that `utc_text` wrote, since 1970. Raises ValueError."""
    whole = datetime.strptime(text, "%Y-%m-%dT%H:%M:%S.%fZ").replace(tzinfo=UTC)
    return round(whole.timestamp() * 1e6) * 1000


def text_of(line: Line, columns: Sequence[str] = COLUMNS) -> str:
    """The line with its check, without its end. `columns`: of its ledger, `check` the last."""
    body = csv_row(getattr(line, name) for name in columns[:-1])
    return f"{body},{zlib.crc32(body.encode()):08x}"


def line_of(text: str) -> Line:
    """The line of a text. Raises SessionError: it is cut short or damaged."""
    body, _, check = text.rpartition(",")
    if check != f"{zlib.crc32(body.encode()):08x}":
        raise SessionError(f"line {brief(text)} is cut short or damaged: its check is not {brief(check)}")
    try:
        cells = next(csv.reader([body]))
    except (csv.Error, StopIteration) as error:
        raise SessionError(f"line {brief(text)} is no row of a table: {error}") from error
    return record_of(Line, dict(zip(COLUMNS, cells, strict=False)))
