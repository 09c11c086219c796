# SPDX-License-Identifier: Apache-2.0
"""What a person sees during set-up. Everything goes to stderr, so that a command's own output stays clean."""

import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

QUIET_INTERVAL_S = 10.0  # where there is no terminal, a line this often
TERMINAL_INTERVAL_S = 0.2


class Progress:
    """Numbered steps, each with one line that changes (on a terminal) or is repeated now and then (elsewhere)."""

    def __init__(self, steps: int, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty() and os.environ.get("TERM") != "dumb"
        self._steps = steps
        self._step = 0
        self._started = self._shown = time.monotonic()
        self._detail = ""

    @contextmanager
    def step(self, title: str) -> Iterator[None]:
        """One numbered step, while it is under way."""
        self._step += 1
        self._started = time.monotonic()
        self._shown = self._started
        self._detail = ""
        self._line(f"[{self._step}/{self._steps}] {title} …")
        try:
            yield
        except BaseException:
            if self._terminal:
                self._line("")
            raise
        self._show(f"{self._detail or 'done'}, {self._elapsed()}", last=True)

    def update(self, detail: str) -> None:
        """Says how far the step is, for example '84 of 163 packages'."""
        self._detail = detail
        self.tick()

    def result(self, detail: str) -> None:
        """Says what the step came to; shown when it ends."""
        self._detail = detail

    def tick(self) -> None:
        """To be called often; shows the time passing."""
        now = time.monotonic()
        if now - self._shown >= (TERMINAL_INTERVAL_S if self._terminal else QUIET_INTERVAL_S):
            self._shown = now
            self._show(f"{self._detail or 'working'}, {self._elapsed()}", last=False)

    def _elapsed(self) -> str:
        return f"{time.monotonic() - self._started:.0f} s"

    def _show(self, text: str, *, last: bool) -> None:
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1  # a line that wraps could not be overwritten
            self._stream.write("\r\033[K" + f"      {text}"[:width] + ("\n" if last else ""))
            self._stream.flush()
        else:
            self._line(f"      {text}")

    def _line(self, text: str) -> None:
        print(text, file=self._stream, flush=True)
