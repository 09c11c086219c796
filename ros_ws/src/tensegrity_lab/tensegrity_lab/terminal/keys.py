# SPDX-License-Identifier: Apache-2.0
"""Single keys of a terminal, without Enter and without a library."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from tensegrity_lab.errors import KeyboardMissing

UP, DOWN, RIGHT, LEFT, PAGE_UP, PAGE_DOWN, ENTER, ESCAPE = "up", "down", "right", "left", "page up", "page down", "enter", "escape"

_ARROWS = {"A": UP, "B": DOWN, "C": RIGHT, "D": LEFT}
_SEQUENCES = {lead + letter: key for lead in "[O" for letter, key in _ARROWS.items()} | {"[5~": PAGE_UP, "[6~": PAGE_DOWN}
_REST_OF_SEQUENCE_S = 0.05
"""A terminal sends the bytes of one key together; a lone Esc is a person's."""


def require_keyboard() -> None:
    """Raises KeyboardMissing: nobody can press keys here."""
    if not sys.stdin.isatty():
        raise KeyboardMissing("standard input is no terminal: run this command in one, it asks for keys")


class Keys:
    """Keys as they are pressed, at a terminal (made by `pressed`) and at whatever else writes what a terminal would."""

    def __init__(self, *descriptors: int):
        self._descriptors = descriptors
        self._from = descriptors[0]

    def and_from(self, descriptor: int) -> Keys:
        """These keys, and those of another descriptor."""
        return Keys(*self._descriptors, descriptor)

    def next(self) -> str:
        """Waits for a key: a character, or one of the names above. Raises EOFError: the terminal is gone."""
        self._from = select.select(self._descriptors, [], [])[0][0]
        character = self._read()
        if character in ("\r", "\n"):
            return ENTER
        if character != "\x1b":
            return character
        sequence = ""
        while len(sequence) < 4 and sequence not in _SEQUENCES and self._more():
            sequence += self._read()
        return _SEQUENCES.get(sequence, ESCAPE)

    def poll(self, wait_s: float = 0.0) -> str | None:
        """A key, if one is pressed within that time, as `next`; None: none was. Raises EOFError."""
        return self.next() if select.select(self._descriptors, [], [], wait_s)[0] else None

    def _read(self) -> str:
        data = os.read(self._from, 1)
        if not data:
            raise EOFError
        return data.decode("latin-1")

    def _more(self) -> bool:
        return bool(select.select([self._from], [], [], _REST_OF_SEQUENCE_S)[0])


@contextmanager
def pressed() -> Iterator[Keys]:
    """Keys one by one, not echoed, until the end of the block; Ctrl-C stays what it is."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSADRAIN)
    try:
        yield Keys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
