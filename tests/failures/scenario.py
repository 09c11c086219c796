# SPDX-License-Identifier: Apache-2.0
"""What a scenario is: a failure, what must come of it, and how it is made to happen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.failures.rig import Rig


@dataclass
class Evidence:
    """What was seen.

    Attributes:
        told: what the operator reads: the stack's own words, in the order in which they came.
        figures: what was measured, by name with its unit.
        rows: table rows of boards: for each board, what was found.
    """

    told: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)
    rows: dict[str, dict[str, str]] = field(default_factory=dict)

    def says(self, text: str, *wanted: str) -> None:
        """The stack said this; fails unless every `wanted` part is in it."""
        for part in wanted:
            expect(part in text, f"expected {part!r} in: {text!r}")
        self.told.append(text)


@dataclass(frozen=True)
class Scenario:
    """One row of the table of failures.

    Attributes:
        number: its row.
        failure: what goes wrong.
        happens: what the stack does about it.
        remedy: what the operator does about it.
        run: makes it happen; raises AssertionError if anything else comes of it than must.
    """

    number: int
    failure: str
    happens: str
    remedy: str
    run: Callable[[Rig], Evidence]


def expect(condition: object, what: str) -> None:
    """Fails, saying `what`, unless the condition holds."""
    if not condition:
        raise AssertionError(what)
