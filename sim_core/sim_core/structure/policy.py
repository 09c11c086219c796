# SPDX-License-Identifier: Apache-2.0
"""Policies: six strokes in whole millimetres."""

from collections.abc import Sequence

import numpy as np

from sim_core.errors import PolicyError
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype

Policy = tuple[int, int, int, int, int, int]


def checked_policy(values: Sequence[float], limit_mm: int) -> Policy:
    """The policy, if it is six whole mm within ±limit; else PolicyError naming strut, value and limit."""
    given = list(values)
    if len(given) != 6:
        raise PolicyError(f"a policy has six strokes in mm, S1..S6; got {len(given)}: {given}")
    for strut, value in enumerate(given, start=1):
        if not isinstance(value, (int, float, np.integer, np.floating)) or isinstance(value, bool) or value != value:  # noqa: PLR0124 (not a number)
            raise PolicyError(f"S{strut} = {value!r}: valid is a whole number of mm in [-{limit_mm}, {limit_mm}]")
        if abs(value) > limit_mm or value != int(value):
            raise PolicyError(f"S{strut} = {value:g} mm: valid is a whole number of mm in [-{limit_mm}, {limit_mm}]")
    a, b, c, d, e, f = (int(value) for value in given)
    return a, b, c, d, e, f


def lengths_of(prototype: Prototype, policy: Sequence[int]) -> Array:
    """Rest lengths (m) that a policy commands, (6,)."""
    return prototype.strut_length_m + 1e-3 * np.asarray(policy, dtype=float)


def neutral_lengths(prototype: Prototype) -> Array:
    """Rest lengths at mid stroke, (6,)."""
    return np.full(6, prototype.strut_length_m)
