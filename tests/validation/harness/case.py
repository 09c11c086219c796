# SPDX-License-Identifier: Apache-2.0
"""What a validation case is: one number measured on the solver beside a reference that the solver had no part in."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from numpy.typing import NDArray

from sim_core.structure.parameters import Prototype


class Setting(NamedTuple):
    """What a case runs with.

    Attributes:
        prototype: the robot; cases of motion switch its mass damping off themselves.
        full: False shortens the longest runs, for tests.
    """

    prototype: Prototype
    full: bool = True


class Curve(NamedTuple):
    """One curve of a picture; `marks` draws points, else a line."""

    label: str
    x: NDArray[Any] | Sequence[float]
    y: NDArray[Any] | Sequence[float]
    marks: bool = False


class Picture(NamedTuple):
    """Data of a picture: curves over axes with units; `equal` keeps lengths on both axes alike."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False
    equal: bool = False


class Comparison(NamedTuple):
    """Numbers in `unit` ("1": none); `tolerance` is a share of the reference if `relative`, else in `unit`."""

    measured: float
    reference: float
    unit: str
    tolerance: float
    relative: bool = True

    @property
    def error(self) -> float:
        """|measured − reference|, as a share of the reference if `relative`."""
        error = abs(self.measured - self.reference)
        return error / abs(self.reference) if self.relative else error

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance."""
        return bool(math.isfinite(self.measured) and self.error <= self.tolerance)


class Case(NamedTuple):
    """The outcome of one case.

    Attributes:
        name: a few words.
        checked: what is checked, one sentence.
        source: the reference's formula and where it is from.
        result: what came out.
        note: what else a reader should know; may be empty.
    """

    name: str
    checked: str
    source: str
    result: Comparison
    note: str = ""
    picture: Picture | None = None
