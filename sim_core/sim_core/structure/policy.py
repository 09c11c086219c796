# SPDX-License-Identifier: Apache-2.0
"""Policies: six strokes in whole millimetres; or six for each of two stages, of which the second follows without a stop."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sim_core.errors import PolicyError
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype

Policy = tuple[int, ...]
MOST_STAGES = 2
"""Of a primitive's policy."""


def checked_policy(values: Sequence[float], limit_mm: int, stages: int = 1) -> Policy:
    """The policy, if it is six whole mm within ±limit for each of at most so many stages; else PolicyError naming what is not."""
    given = list(values)
    if len(given) not in range(6, 6 * stages + 1, 6):
        more = f", or for each of {stages} stages" if stages > 1 else ""
        raise PolicyError(f"a policy has six strokes in mm, S1..S6{more}; got {len(given)}: {given}")
    for place, value in enumerate(given):
        strut = place % 6 + 1
        if not isinstance(value, (int, float, np.integer, np.floating)) or isinstance(value, bool) or value != value:  # noqa: PLR0124 (not a number)
            raise PolicyError(f"S{strut} = {value!r}: valid is a whole number of mm in [-{limit_mm}, {limit_mm}]")
        if abs(value) > limit_mm or value != int(value):
            raise PolicyError(f"S{strut} = {value:g} mm: valid is a whole number of mm in [-{limit_mm}, {limit_mm}]")
    return tuple(int(value) for value in given)


def in_stages(policy: Policy) -> list[Policy]:
    """Six strokes for each stage, in order."""
    return [policy[at : at + 6] for at in range(0, len(policy), 6)]


def ways_mm(policy: Policy) -> list[int]:
    """How far each strut goes, from neutral through all stages and back, (6,)."""
    stops = [(0,) * 6, *in_stages(policy), (0,) * 6]
    return [sum(abs(b - a) for a, b in pairwise(strokes)) for strokes in zip(*stops, strict=True)]


def lengths_of(prototype: Prototype, policy: Sequence[int]) -> Array:
    """Rest lengths (m) that a policy commands, (6,)."""
    return prototype.strut_length_m + 1e-3 * np.asarray(policy, dtype=float)


def neutral_lengths(prototype: Prototype) -> Array:
    """Rest lengths at mid stroke, (6,)."""
    return np.full(6, prototype.strut_length_m)
