# SPDX-License-Identifier: Apache-2.0
"""What a validation case is: one number measured on the solver beside a reference that the solver had no part in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sim_core.structure.parameters import Prototype


class Setting(NamedTuple):
    """What a case runs with.

    Attributes:
        prototype: the robot; cases of motion switch its mass damping off themselves.
        full: False shortens the longest runs, for tests.
    """

    prototype: Prototype
    full: bool = True


@dataclass(frozen=True)
class Curve:
    """One curve of a picture; `marks` draws points, else a line."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    marks: bool = False


def curve(label: str, x: ArrayLike, y: ArrayLike, marks: bool = False) -> Curve:
    """A curve from any numbers."""
    return Curve(label, tuple(np.asarray(x, dtype=float).tolist()), tuple(np.asarray(y, dtype=float).tolist()), marks)


@dataclass(frozen=True)
class Picture:
    """Data of a picture: curves over axes with units; `equal` keeps lengths on both axes alike."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False
    equal: bool = False


@dataclass(frozen=True)
class Case:
    """The outcome of one case.

    Attributes:
        name: a few words.
        checked: what is checked, one sentence.
        source: the reference's formula and where it is from.
        measured, reference: in `unit` ("1" if they have none).
        tolerance: of `error`; a share of the reference if `relative`, else in `unit`.
        note: what else a reader should know; may be empty.
    """

    name: str
    checked: str
    measured: float
    reference: float
    unit: str
    tolerance: float
    source: str
    relative: bool = True
    note: str = ""
    picture: Picture | None = None

    @property
    def error(self) -> float:
        """|measured − reference|, as a share of the reference if `relative`."""
        error = abs(self.measured - self.reference)
        return error / abs(self.reference) if self.relative else error

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance."""
        return bool(math.isfinite(self.measured) and self.error <= self.tolerance)
