# SPDX-License-Identifier: Apache-2.0
import os
import signal
import sys
import time
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import pytest

from tooling.layout import SetupError
from tooling.process import Runner
from tooling.progress import Progress


@pytest.fixture
def runner(tmp_path: Path) -> Iterator[Runner]:
    lock = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    yield Runner(tmp_path / "log", lock, Progress(1, StringIO()))
    os.close(lock)


def run(runner: Runner, code: str, **callbacks) -> None:
    runner.run("the step", [sys.executable, "-S", "-c", code], cwd=runner.log.parent, environ=os.environ, **callbacks)


def test_each_line_goes_to_the_callback_and_to_the_log(runner: Runner):
    lines: list[str] = []
    run(runner, "print('one'); print('two', end='')", on_line=lines.append)
    assert lines == ["one", "two"]
    assert "one\ntwo" in runner.log.read_text()


def test_a_failure_shows_the_last_lines_and_where_the_log_is(runner: Runner):
    with pytest.raises(SetupError) as error:
        run(runner, "for i in range(99): print('line', i)\nraise SystemExit(7)")
    text = str(error.value)
    assert "the step failed (exit code 7)" in text
    assert "line 98" in text
    assert "line 60" not in text
    assert str(runner.log) in text


def test_an_interrupt_ends_the_program_and_its_children(runner: Runner):
    """The program starts a child and tells its id; by then both would run for a minute."""
    children: list[int] = []

    def interrupt(line: str) -> None:
        children.append(int(line))
        raise KeyboardInterrupt

    code = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen(['sleep', '60'], stdout=subprocess.DEVNULL)\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with pytest.raises(KeyboardInterrupt):
        run(runner, code, on_line=interrupt)
    (child,) = children
    end = time.monotonic() + 10.0  # the program is waited for; its child, signalled with it, may be later on a busy machine
    while _state(child) not in ("gone", "Z"):
        assert time.monotonic() < end, f"the child runs on: {_state(child)}"
        time.sleep(0.01)


def test_a_program_inherits_the_lock_so_that_it_outlives_a_killed_set_up(runner: Runner):
    lines: list[str] = []
    run(runner, f"import os; print(os.fstat({runner.lock}).st_ino)", on_line=lines.append)
    assert lines == [str(os.fstat(runner.lock).st_ino)]


def test_a_program_that_ignores_the_polite_signal_is_ended_all_the_same(runner: Runner, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tooling.process.GRACE_S", 0.2)
    seen: list[int] = []

    def interrupt(line: str) -> None:
        seen.append(int(line))
        raise KeyboardInterrupt

    number = int(signal.SIGTERM)
    code = f"import os, signal, time; signal.signal({number}, signal.SIG_IGN); print(os.getpid(), flush=True); time.sleep(60)"
    with pytest.raises(KeyboardInterrupt):
        run(runner, code, on_line=interrupt)
    assert _state(seen[0]) == "gone"


def _state(process: int) -> str:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "gone"
