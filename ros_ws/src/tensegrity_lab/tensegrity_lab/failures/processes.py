# SPDX-License-Identifier: Apache-2.0
"""The stack's real executables as processes of their own, and waiting with limits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ament_index_python.packages import get_package_prefix

from hardware_bridge.driver.child_process import bound

START_LIMIT_S = 30.0
END_LIMIT_S = 20.0


def wait_until(condition: Callable[[], object], limit_s: float, what: str) -> None:
    """Wait until a condition holds; fail naming `what` after the limit."""
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"{what} did not come within {limit_s:g} s")
        time.sleep(0.005)


class Process:
    """One program, by default an executable of the workspace, in a session of its own, so that a signal reaches it alone.

    Attributes:
        name: of the executable.
        output: what it has written so far, both streams.
    """

    def __init__(
        self,
        name: str,
        *words: str,
        folder: Path,
        environ: dict[str, str],
        program: Sequence[str] = (),
        locks: tuple[int, ...] = (),
    ):
        if not program:
            program = [str(Path(get_package_prefix("tensegrity_robot")) / "lib" / "tensegrity_robot" / name)]
        self.name = name
        self._log = folder / f"{name}-{time.monotonic_ns()}.log"
        with self._log.open("wb") as log:
            self._child = subprocess.Popen(
                bound([*program, *words]),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=locks,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **environ},
                cwd=folder,
            )

    @property
    def output(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")

    @property
    def pid(self) -> int:
        """Its process."""
        return self._child.pid

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._child.poll()

    def says(self, text: str, limit_s: float = START_LIMIT_S) -> None:
        """Wait until it has written `text`; fail if it ends before."""
        wait_until(lambda: text in self.output or self.code is not None, limit_s, f"{text!r} of {self.name}: {self.output}")
        assert text in self.output, f"{self.name} ended with {self.code} without {text!r}: {self.output}"

    def signal(self, number: signal.Signals) -> None:
        os.killpg(self._child.pid, number)

    def ends(self, limit_s: float = END_LIMIT_S) -> int:
        """Wait for its end; its exit code."""
        wait_until(lambda: self.code is not None, limit_s, f"the end of {self.name}: {self.output}")
        return self._child.returncode

    def kill(self) -> None:
        if self.code is None:
            os.killpg(self._child.pid, signal.SIGKILL)
        self._child.wait()


class Processes:
    """Starts processes with one state folder, bag folder and ROS domain, and leaves none behind."""

    def __init__(self, folder: Path, domain: int, locks: tuple[int, ...] = ()):
        """Args: locks: descriptors that the processes keep open, so that the locks live as long as they do."""
        self.folder = folder
        self._locks = locks
        self.bags = folder / "bags"
        self._environ = {
            "SIXSTRUT_STATE_DIR": str(folder / "state"),
            "SIXSTRUT_BAGS": str(self.bags),
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        self._started: list[Process] = []

    def start(self, name: str, *words: str, environ: dict[str, str] | None = None, **parameters: object) -> Process:
        """Start an executable with arguments, or a node with parameters; `environ` is added to the environment."""
        given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={_text(value)}")]
        process = Process(
            name,
            *words,
            *(["--ros-args", *given] if given else []),
            folder=self.folder,
            environ={**self._environ, **(environ or {})},
            locks=self._locks,
        )
        self._started.append(process)
        return process

    def command(self, *words: str) -> Process:
        """Start a `sixstrut` command beside them."""
        program = [sys.executable, "-m", "sixstrut_cli"]
        process = Process(words[0], *words, folder=self.folder, environ=self._environ, program=program, locks=self._locks)
        self._started.append(process)
        return process

    def stop(self) -> dict[str, int]:
        """SIGINT to all that still run, last started first; exit codes by name."""
        codes = {}
        for process in reversed(self._started):
            if process.code is None:
                process.signal(signal.SIGINT)
                codes[process.name] = process.ends()
        self._started.clear()
        return codes

    def kill(self) -> None:
        for process in reversed(self._started):
            process.kill()
        self._started.clear()


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f'"{value}"' if value == "" else str(value)
