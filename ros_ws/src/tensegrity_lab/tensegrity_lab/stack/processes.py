# SPDX-License-Identifier: Apache-2.0
"""The stack's processes, started and stopped together: each a real executable, each with its own log file."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Self

from hardware_bridge.driver.child_process import bound
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.simulation_lag import busy_text

START_LIMIT_S = 60.0
STOP_LIMIT_S = 20.0


def executable(package: str, name: str) -> Path:
    """An executable of the built workspace; StackError if it is not there."""
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix

    try:
        path = Path(get_package_prefix(package)) / "lib" / package / name
    except PackageNotFoundError as error:
        raise StackError(f"package {package} is not built: run ./sixstrut setup") from error
    if not path.exists():
        raise StackError(f"{path} does not exist: run ./sixstrut setup")
    return path


def _private(path: str, flags: int) -> int:
    """For `open`: a file that is this user's alone."""
    return os.open(path, flags, 0o600)


def ros_arguments(parameters: Mapping[str, object]) -> list[str]:
    """`--ros-args -p name:=value …`; nothing without parameters."""
    words = ["--ros-args"] if parameters else []
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else '""' if value == "" else str(value)
        words += ["-p", f"{name}:={text}"]
    return words


class Process:
    """One program in a session of its own: a Ctrl-C at the terminal does not reach it, and a signal reaches it alone.

    If the process that started it is killed, it is interrupted: a bridge then holds the struts and closes its bag.

    Attributes:
        name: what it is called.
        log: the file of its output, both streams; this user's alone, because a console's holds its address.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str | Path],
        log: Path,
        environ: Mapping[str, str] | None = None,
        folder: Path | None = None,
        locks: Sequence[int] = (),
    ):
        """Args: environ: beside what this process has. folder: it works there. locks: descriptors that it keeps open."""
        self.name, self.log = name, log
        with open(log, "wb", opener=_private) as output:
            self._child = subprocess.Popen(
                bound(command),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=locks,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(environ or {})},
                cwd=folder,
            )

    @property
    def output(self) -> str:
        """What it has written so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._child.pid

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._child.poll()

    def require_alive(self) -> None:
        """Raise StackError with the last line of its log if it has ended."""
        if self.code is not None:
            lines = [line for line in self.output.splitlines() if line.strip()]
            said = lines[-1] if lines else "it said nothing"
            raise StackError(f"{self.name} ended with exit code {self.code}: {said} (log: {self.log})")

    def says(self, text: str, limit_s: float = START_LIMIT_S) -> None:
        """Wait until it has written `text`. Raises StackError: it does not, or ends before."""
        wait_until(lambda: text in self.output or self.code is not None, limit_s, f"{text!r} of {self.name}: {self.output}")
        if text not in self.output:
            raise StackError(f"{self.name} ended with {self.code} without {text!r}: {self.output}")

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        os.killpg(self.pid, number)

    def ends(self, limit_s: float = STOP_LIMIT_S) -> int:
        """Wait for its end; its exit code. Raises StackError: it goes on."""
        wait_until(lambda: self.code is not None, limit_s, f"the end of {self.name}: {self.output}")
        return self._child.returncode

    def kill(self) -> None:
        """End it at once, if it still runs."""
        if self.code is None:
            self.signal(signal.SIGKILL)
        self._child.wait()


class Stack:
    """Processes that are started one by one and ended together, in order.

    Attributes:
        folder: of their logs.
        codes: exit codes by name of those that were stopped.
    """

    def __init__(self, folder: Path, *locks: int, environ: Mapping[str, str] | None = None, work_folder: Path | None = None):
        """Nothing runs yet.

        Args:
            folder: of their logs; made if it is not there.
            locks: descriptors that the processes keep open, so that the locks outlive this process as long as they live.
            environ: of all of them, beside what this process has.
            work_folder: they work there; None: here.
        """
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._locks, self._environ, self._work_folder = locks, environ or {}, work_folder
        self._started: list[Process] = []
        self.codes: dict[str, int] = {}

    def start(self, name: str, command: Sequence[str | Path], environ: Mapping[str, str] | None = None) -> Process:
        """Start a process; its output goes to <folder>/<name>.log. Args: environ: beside the stack's."""
        again = sum(process.name == name for process in self._started)
        log = self.folder / (f"{name}-{again + 1}.log" if again else f"{name}.log")
        process = Process(name, command, log, {**self._environ, **(environ or {})}, self._work_folder, self._locks)
        self._started.append(process)
        return process

    def node(self, name: str, *words: str, environ: Mapping[str, str] | None = None, **parameters: object) -> Process:
        """Start an executable of tensegrity_robot with words and ROS parameters. Args: environ: beside the stack's."""
        return self.start(name, [executable("tensegrity_robot", name), *words, *ros_arguments(parameters)], environ)

    def pid(self, name: str) -> int:
        """Process number of the one started last under a name."""
        return next(process.pid for process in reversed(self._started) if process.name == name)

    def require_alive(self) -> None:
        """Raise StackError with the last line of its log if a process has ended."""
        for process in self._started:
            process.require_alive()

    def stop(self) -> dict[str, int]:
        """SIGINT to each, last started first, and wait; SIGKILL after a limit. Returns `codes`; safe to call twice."""
        for process in reversed(self._started):
            if process.code is None:
                process.signal(signal.SIGINT)
            try:
                self.codes[process.name] = process.ends()
            except StackError:
                process.kill()
                self.codes[process.name] = process.ends()
                print(f"warning: {process.name} did not end within {STOP_LIMIT_S:g} s and was killed")
        self._started.clear()
        return self.codes

    def kill(self) -> None:
        """End all at once."""
        for process in reversed(self._started):
            process.kill()
        self._started.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *details: object) -> None:
        self.stop()


def wait_until(condition: Callable[[], object], limit_s: float, what: str, stack: Stack | None = None) -> None:
    """Wait for a condition, looking often; StackError naming `what` after the limit, or when a process of the stack has died."""
    end = time.monotonic() + limit_s
    while not condition():
        if stack is not None:
            stack.require_alive()
        if time.monotonic() > end:
            busy = f": {busy_text()}" if busy_text() else ""
            where = f"; the logs are in {stack.folder}" if stack is not None else ""
            raise StackError(f"{what} did not come within {limit_s:g} s{busy}{where}")
        time.sleep(0.005)
