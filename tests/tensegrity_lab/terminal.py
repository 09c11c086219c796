# SPDX-License-Identifier: Apache-2.0
"""A person at a real terminal: reads what a command prints on a pty, and presses keys."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

LIMIT_S = 60.0
UP, DOWN, RIGHT, LEFT, PAGE_UP, PAGE_DOWN, ENTER = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D", "\x1b[5~", "\x1b[6~", "\r"
CTRL_C = "\x03"
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal:
    """One `sixstrut` command on a pty of its own.

    Attributes:
        text: all that it has printed so far, without colours.
    """

    def __init__(self, *words: str, environ: dict[str, str] | None = None, folder: Path | None = None):
        self.text = ""
        self._at = 0
        self._code: int | None = None
        program = [sys.executable, "-m", "sixstrut_cli", *words]
        self._pid, self._terminal = pty.fork()
        if self._pid == 0:  # the command
            if folder is not None:
                os.chdir(folder)
            os.execve(sys.executable, program, {**os.environ, "TERM": "xterm", **(environ or {})})
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 200, 0, 0))

    def says(self, *wanted: str, limit_s: float = LIMIT_S) -> str:
        """Waits until it has said one of the texts, however broken into lines, after what was waited for before; that text."""
        end = time.monotonic() + limit_s
        patterns = [(re.compile(re.escape(text).replace("\\ ", r"\s+")), text) for text in wanted]
        while True:
            found = [(match.span(), text) for pattern, text in patterns if (match := pattern.search(self.text, self._at))]
            if found:
                (_, self._at), text = min(found)
                return text
            assert self._read(end - time.monotonic()), f"waited for {wanted}; it said: {self.text[-1500:]}"

    def reads_until(self, condition: Callable[[], object], limit_s: float = LIMIT_S) -> None:
        """Takes in what it prints (a terminal that nobody reads blocks its program) until something else is true."""
        end = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < end, f"waited in vain; it said: {self.text[-1500:]}"
            self._read(0.1)

    def press(self, *keys: str) -> None:
        """Types."""
        os.write(self._terminal, "".join(keys).encode())

    def ends(self, limit_s: float = LIMIT_S) -> int:
        """Its exit code."""
        end = time.monotonic() + limit_s
        while self._read(end - time.monotonic()):
            continue
        while self._code is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._code = os.waitstatus_to_exitcode(status)
            else:
                assert time.monotonic() < end, f"it does not end; it said: {self.text[-1500:]}"
                time.sleep(0.01)
        return self._code

    def leaves(self, limit_s: float = LIMIT_S) -> int:
        """Its exit code, after Ctrl-C. Again if nothing comes of it: it is lost while `input` begins."""
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            self.press(CTRL_C)
            try:
                return self.ends(2.0)
            except (AssertionError, OSError):
                continue
        return self.ends(1.0)

    def close(self) -> None:
        """Ends it, if it runs."""
        if self._code is None:
            os.kill(self._pid, signal.SIGTERM)
            self._code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        os.close(self._terminal)

    def _read(self, wait_s: float) -> bool:
        """Takes in what it prints; False at its end, or after the limit."""
        if wait_s <= 0 or not select.select([self._terminal], [], [], wait_s)[0]:
            return False
        try:
            data = os.read(self._terminal, 65536)
        except OSError:  # a pty whose other end is closed
            return False
        self.text += _ESCAPES.sub("", data.decode("utf-8", errors="replace")).replace("\r", "")
        return bool(data)
