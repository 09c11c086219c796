# SPDX-License-Identifier: Apache-2.0
"""How much is tried: the quick suite tries a part of what `./sixstrut test --all` tries."""

import os

ALL = os.environ.get("SIXSTRUT_TEST_ALL") == "1"


def examples(most: int) -> int:
    """How many examples a property is tried on: all, or a fifth of them, 10 at least."""
    return most if ALL else max(10, most // 5)
