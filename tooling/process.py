# SPDX-License-Identifier: Apache-2.0
"""Runs one step's program: output to the log and to a callback, nothing left behind if set-up is interrupted."""

import os
import selectors
import shlex
import signal
import subprocess
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tooling.layout import SetupError
from tooling.progress import Progress

POLL_S = 0.2
GRACE_S = 5.0
TAIL_LINES = 30  # colcon tells the cause well before its summary


@dataclass(frozen=True)
class Runner:
    """Runs the programs of one set-up.

    lock: the set-up lock's file descriptor, inherited by each program. Should set-up itself be killed, the lock stays
    taken until the program, which nobody stops then, has ended too.
    """

    log: Path
    lock: int
    progress: Progress

    def run(
        self,
        what: str,
        command: Sequence[str],
        *,
        cwd: Path,
        environ: Mapping[str, str],
        on_line: Callable[[str], None] = lambda line: None,
        on_tick: Callable[[], None] | None = None,
    ) -> None:
        """Raises SetupError with the last lines of output if the program fails."""
        tail: deque[str] = deque(maxlen=TAIL_LINES)
        with self.log.open("ab") as file:
            file.write(f"\n$ {shlex.join(command)}\n".encode())
            file.flush()
            process = subprocess.Popen(
                command,
                cwd=cwd,
                env=dict(environ),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=[self.lock],
            )
            try:
                for line in _lines(process, on_tick or self.progress.tick):
                    file.write(line)
                    file.flush()
                    text = line.decode("utf-8", errors="replace").rstrip()
                    tail.append(text)
                    on_line(text)
                code = process.wait()
            finally:
                _end(process)
        if code != 0:
            last = "\n".join(f"  | {line}" for line in tail)
            raise SetupError(f"{what} failed (exit code {code}). Its last lines:\n{last}\nThe whole log: {self.log}")


def _lines(process: subprocess.Popen[bytes], on_tick: Callable[[], None]) -> Iterator[bytes]:
    """The program's output, line by line, calling on_tick while there is none."""
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    pending = b""
    with selectors.DefaultSelector() as selector:
        selector.register(descriptor, selectors.EVENT_READ)
        while True:
            if selector.select(POLL_S):
                block = os.read(descriptor, 65536)
                if not block:
                    break
                *lines, pending = (pending + block).split(b"\n")
                for line in lines:
                    yield line + b"\n"
            on_tick()
    if pending:
        yield pending


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends the program and all that it started, if it still runs."""
    if process.stdout is not None:
        process.stdout.close()
    if process.poll() is not None:
        return
    for number in (signal.SIGTERM, signal.SIGKILL):
        os.killpg(process.pid, number)
        try:
            process.wait(GRACE_S)
            return
        except subprocess.TimeoutExpired:
            continue
