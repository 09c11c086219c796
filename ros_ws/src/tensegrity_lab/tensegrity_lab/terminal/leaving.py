# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C while something long is computed, and while something must be whole."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_INTERRUPTED = 130
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SHOW_CURSOR = "\x1b[?25h"


@contextmanager
def leaves_at_once(kept: str) -> Iterator[None]:
    """Within the block Ctrl-C says what was kept and ends the process there and then.

    Only for blocks that compute, and write files whole or not at all: nothing is unwound. An exception would have to wait until
    every thread has finished its share, and can be lost on its way through compiled code.

    Args:
        kept: What is not lost, and how to go on.
    """

    def leave(_number: int, _frame: FrameType | None) -> None:
        shown = _SHOW_CURSOR if sys.stderr.isatty() else ""
        os.write(2, f"{shown}\ninterrupted: {kept}\n".encode())
        os._exit(EXIT_INTERRUPTED)

    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def uninterrupted(again: bool = False) -> Iterator[list[int]]:
    """Signals wait until the block is over: a second Ctrl-C must not lose a bag. For the main thread.

    Args:
        again: they come then; else they are only remembered.

    Yields:
        numbers of those that came: who would go on with something else should end instead.
    """
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: came.append(number)) for number in _SIGNALS}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for late in came if again else ():
            signal.raise_signal(late)
