# SPDX-License-Identifier: Apache-2.0
from io import StringIO

import pytest

from tooling import progress
from tooling.progress import Progress


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that stands still until its one entry is changed."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_steps_are_numbered_and_end_with_their_result_and_time(clock: list[float]):
    stream = StringIO()
    shown = Progress(2, stream)
    with shown.step("installing 3 packages"):
        clock[0] += 4.2
        shown.result("3 packages")
    with shown.step("building"):
        pass
    assert stream.getvalue().splitlines() == [
        "[1/2] installing 3 packages …",
        "      3 packages, 4 s",
        "[2/2] building …",
        "      done, 0 s",
    ]


def test_without_a_terminal_a_line_appears_every_ten_seconds(clock: list[float]):
    stream = StringIO()
    shown = Progress(1, stream)
    with shown.step("building"):
        for second in range(25):
            clock[0] = 100.0 + second
            shown.update(f"{second} of 25")
    assert [line.strip() for line in stream.getvalue().splitlines()[1:]] == ["10 of 25, 10 s", "20 of 25, 20 s", "24 of 25, 24 s"]


def test_on_a_dumb_terminal_lines_stay(clock: list[float], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    with Progress(1, stream).step("building"):
        pass
    assert stream.getvalue() == "[1/1] building …\n      done, 0 s\n"


def test_on_a_terminal_one_line_changes_and_never_wraps(clock: list[float], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "20")
    stream = Terminal()
    shown = Progress(1, stream)
    with shown.step("building"):
        clock[0] += 1
        shown.update("a long name that does not fit")
        clock[0] += 1
        shown.update("short")
    _, *updates = stream.getvalue().split("\r\033[K")
    assert updates == ["      a long name t", "      short, 2 s", "      short, 2 s\n"]


def test_a_step_that_fails_claims_no_result(clock: list[float]):
    stream = StringIO()
    with pytest.raises(RuntimeError), Progress(1, stream).step("building"):
        raise RuntimeError
    assert stream.getvalue() == "[1/1] building …\n"
