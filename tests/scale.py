# SPDX-License-Identifier: Apache-2.0
"""How much is tried: the quick suite tries a part of what `./sixstrut test --all` tries."""

import os
from collections.abc import Iterable
from typing import Any

import pytest

ALL = os.environ.get("SIXSTRUT_TEST_ALL") == "1"


def examples(most: int) -> int:
    """How many examples a property is tried on: all, or a fifth of them, 10 at least."""
    return most if ALL else max(10, most // 5)


def few(cases: Iterable[Any], quick: int) -> list[Any]:
    """The first cases for the quick suite, the others marked slow: for cases that all go the same way through a process."""
    found = list(cases)
    slow = [case if isinstance(case, tuple) else (case,) for case in found[quick:]]
    return found[:quick] + [pytest.param(*case, marks=pytest.mark.slow) for case in slow]
