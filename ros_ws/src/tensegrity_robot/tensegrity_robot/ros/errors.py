# SPDX-License-Identifier: Apache-2.0
"""Errors of the nodes."""

import difflib
from collections.abc import Collection

from hardware_bridge.errors import BridgeError


class StartError(BridgeError):
    """A node cannot start: one line that says why and what is valid. The process ends with exit code 1."""


def require_known(what: str, names: Collection[str], known: Collection[str], rest: str) -> None:
    """Raises StartError: one of the names is not known; says which is the nearest, and the rest."""
    for name in sorted(set(names) - set(known)):
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
        raise StartError(f"unknown {what} {name}: did you mean {near[0]}? {rest}")
