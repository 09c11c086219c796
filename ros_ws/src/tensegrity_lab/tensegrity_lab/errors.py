# SPDX-License-Identifier: Apache-2.0
"""Errors that a person reads: one line, and what to do next."""

from typing import Any

from hardware_bridge.errors import BridgeError


class KeyboardMissing(BridgeError):
    """A command that asks for keys was started where nobody can press them."""


class StackError(BridgeError):
    """The stack did not come up, or a part of it died."""


class SessionError(BridgeError):
    """A session of trials that cannot be begun, gone on with, or reported."""


class ConsoleError(BridgeError):
    """A console that cannot be opened as asked."""


def granted(answer: Any, what: str) -> Any:
    """The answer of a service. Raises StackError with its reason: it was refused. Args: what: is said before the reason."""
    if not answer.success:
        raise StackError(f"{what}: {answer.message}")
    return answer
