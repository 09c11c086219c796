# SPDX-License-Identifier: Apache-2.0
"""`./sixstrut test`: everything that has to hold before a change goes in."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from hardware_bridge.driver.child_process import bound
from sim_core.files.places import temporary_parent
from sixstrut_cli.outputs import repository
from tensegrity_lab.stack.ros_domain import private_domain

CONTEXT_SETTINGS = {"allow_extra_args": True, "ignore_unknown_options": True}

_CHECKS = {
    "ruff check": ["-m", "ruff", "check", "."],
    "ruff format": ["-m", "ruff", "format", "--check", "."],
    "mypy": ["-m", "mypy"],
    "imports": ["-c", "from importlinter.cli import lint_imports_command as check; check()"],
}
_SOAK = ["tests/soak", "-m", "soak", "-q"]
_FINE = (0, 5)  # 5: pytest found no test of that kind
_WORKERS = ["-n", "2", "--dist", "loadfile", "-q", "--durations=10"]


def command(
    context: typer.Context,
    everything: Annotated[
        bool, typer.Option("--all", help="The slow tests as well, and properties on all their examples.")
    ] = False,
    slow: Annotated[bool, typer.Option("--slow", help="Only what --all has more than the quick tests.")] = False,
    soak: Annotated[bool, typer.Option("--soak", help="The long tests instead, with their figures: a quarter of an hour.")] = False,
    minutes: Annotated[float | None, typer.Option(min=1.0, help="Begin no test after so long; those left out are told.")] = None,
) -> None:
    """Run the linter, the format check, the type checker, the rules of who imports whom, and the quick tests.

    With arguments, run only pytest with these: ./sixstrut test tests/sim_core -k symmetry

    With --soak, run the long ones: a million byte sequences through every decoder, 200 killed recorders, 200 stops under load, an
    hour of robot time with faults at random. They need a machine that is not busy.
    """
    root = repository("tests/sixstrut_cli").parents[1]
    signal.signal(signal.SIGTERM, _on_sigterm)
    chosen = [*(_SOAK if soak else []), *context.args]
    kind = "slow" if slow else "not soak" if everything else "not slow and not soak"
    whole = {**({} if slow else _CHECKS), "tests": ["-m", "pytest", "-m", kind, *_WORKERS]}
    steps = {"pytest": ["-m", "pytest", *chosen]} if chosen else whole
    with private_domain() as domain, tempfile.TemporaryDirectory(prefix="sixstrut-test-", dir=temporary_parent()) as state:
        environ = {**os.environ, "SIXSTRUT_STATE_DIR": state}  # tests can meet no robot that runs on this machine
        if everything or slow or soak:
            environ["SIXSTRUT_TEST_ALL"] = "1"
        if minutes is not None:
            environ["SIXSTRUT_TEST_MINUTES"] = f"{minutes:g}"
        print(f"ROS domain {domain.number}", flush=True)
        results = [(name, *_run(name, arguments, root, environ, domain.locks)) for name, arguments in steps.items()]
    print()
    for name, code, seconds in results:
        print(f"{'ok' if code == 0 else 'FAILED':6}  {name:20} {seconds:7.1f} s")
    raise typer.Exit(next((code for _, code, _ in results if code not in _FINE), 0))


def _run(name: str, arguments: list[str], root: Path, environ: dict[str, str], locks: tuple[int, ...]) -> tuple[int, float]:
    print(f"\n── {name}", flush=True)
    began = time.monotonic()
    process = subprocess.Popen(bound([sys.executable, *arguments]), cwd=root, env=environ, stdin=subprocess.DEVNULL, pass_fds=locks)
    try:
        code = process.wait()
    except BaseException:
        _end(process)
        raise
    return code, time.monotonic() - began


def _end(process: subprocess.Popen[bytes]) -> None:
    """Lets pytest end the processes of its tests, which it does on SIGINT. At a terminal it got that with us."""
    for number, patience_s in ((0, 2.0), (signal.SIGINT, 10.0), (signal.SIGKILL, None)):
        process.send_signal(number)
        try:
            process.wait(patience_s)
            return
        except subprocess.TimeoutExpired:
            continue


def _on_sigterm(number: int, _frame: FrameType | None) -> None:
    sys.exit(128 + number)
