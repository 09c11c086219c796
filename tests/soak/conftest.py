# SPDX-License-Identifier: Apache-2.0
"""Long tests, for `./sixstrut test --soak` only: each gives figures, which are printed at the end."""

from collections.abc import Callable

import pytest

_FIGURES: list[tuple[str, str]] = []


@pytest.fixture
def figure() -> Callable[[str, object], None]:
    """Tell a figure, by name, for the summary."""

    def tell(name: str, value: object) -> None:
        _FIGURES.append((name, f"{value:g}" if isinstance(value, float) else str(value)))

    return tell


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if not _FIGURES:
        return
    terminalreporter.section("soak")
    width = max(len(name) for name, _ in _FIGURES)
    for name, value in _FIGURES:
        terminalreporter.write_line(f"{name:{width}}  {value}")


@pytest.fixture(scope="module")
def lab():
    """A stack of this module's own, in a ROS domain of its own."""
    from pathlib import Path

    from tests.failures.rig import Rig, scratch
    from tests.isolated_stack import free_domain

    with free_domain() as domain, scratch() as folder:
        lab = Rig(Path(folder), domain)
        yield lab
        lab.close()
