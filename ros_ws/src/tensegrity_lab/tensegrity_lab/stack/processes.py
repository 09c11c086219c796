# SPDX-License-Identifier: Apache-2.0
"""The stack's processes, started and stopped together: each a real executable, each with its own log file."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import FrameType, TracebackType

from hardware_bridge.driver.child_process import bound
from tensegrity_lab.errors import StackError

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
    """`--ros-args -p name:=value …`."""
    words = ["--ros-args"]
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        words += ["-p", f"{name}:={text}"]
    return words


class Stack:
    """Child processes in sessions of their own: a Ctrl-C at the terminal reaches only this process, which ends them in order.

    If this process is killed, they are interrupted: the bridge then holds the struts and closes its bag.
    """

    def __init__(self, log_folder: Path, *locks: int):
        """Args: locks: descriptors that the children keep open, so that the locks outlive this process as long as they live."""
        self.log_folder = log_folder
        log_folder.mkdir(parents=True, exist_ok=True)
        self._kept = locks
        self._children: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: Sequence[str | Path], environ: Mapping[str, str] | None = None) -> None:
        """Start a process; its output goes to <log folder>/<name>.log. Args: environ: beside what this process has."""
        with open(self.log_folder / f"{name}.log", "wb", opener=_private) as log:  # a console's holds its address
            self._children[name] = subprocess.Popen(
                bound(command),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=self._kept,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(environ or {})},
            )

    def pids(self) -> dict[str, int]:
        """Process numbers, by the names given at the start."""
        return {name: child.pid for name, child in self._children.items()}

    def require_alive(self) -> None:
        """Raise StackError with the last lines of its log if a process has ended."""
        for name, child in self._children.items():
            if child.poll() is not None:
                raise StackError(f"{name} ended with exit code {child.returncode}: {self._last_words(name)}")

    def _last_words(self, name: str) -> str:
        path = self.log_folder / f"{name}.log"
        lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
        return f"{lines[-1] if lines else 'it said nothing'} (log: {path})"

    def stop(self) -> dict[str, int]:
        """SIGINT to each, last started first, and wait; SIGKILL after a limit. Returns exit codes; safe to call twice."""
        for name, child in reversed(self._children.items()):
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGINT)
            try:
                child.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
                print(f"warning: {name} did not end within {STOP_LIMIT_S:g} s and was killed")
        codes = {name: child.returncode for name, child in self._children.items()}
        self._children = {}
        return codes

    def __enter__(self) -> Stack:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()


class Uninterrupted:
    """Signals wait while things are being put away: a second Ctrl-C must not lose the bag.

    Attributes:
        interrupted: one came; who would go on with something else should end instead.
    """

    def __enter__(self) -> Uninterrupted:
        self.interrupted = False
        self._old = [signal.signal(number, self._remember) for number in (signal.SIGINT, signal.SIGTERM)]
        return self

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self.interrupted = True

    def __exit__(self, *details: object) -> None:
        for number, old in zip((signal.SIGINT, signal.SIGTERM), self._old, strict=True):
            signal.signal(number, old)


def wait_until(condition: Callable[[], object], limit_s: float, what: str, stack: Stack | None = None) -> None:
    """Wait for a condition, looking often; StackError naming `what` after the limit, or when a process of the stack has died."""
    end = time.monotonic() + limit_s
    while not condition():
        if stack is not None:
            stack.require_alive()
        if time.monotonic() > end:
            raise StackError(f"{what} did not happen within {limit_s:g} s; the logs are in {stack.log_folder if stack else 'none'}")
        time.sleep(0.01)
