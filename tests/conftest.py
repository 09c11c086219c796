# SPDX-License-Identifier: Apache-2.0
"""For all tests: how hypothesis draws, and an end to a run that has a limit."""

import functools
import os
import signal
import time
from pathlib import Path

import pytest
from hypothesis import settings
from xdist.scheduler import LoadFileScheduling

from tests.scale import ALL

if "PYTEST_XDIST_WORKER" in os.environ:  # beside another worker: a core each
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # begun in the background of a shell
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("quick", derandomize=True, deadline=None, database=None)
settings.register_profile("all", deadline=None)
settings.load_profile("all" if ALL else "quick")

_END = time.monotonic() + 60.0 * float(os.environ.get("SIXSTRUT_TEST_MINUTES", "inf"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What starts ROS nodes comes first: with two workers it keeps one of them busy to the end."""
    items.sort(key=lambda item: not _starts_nodes(item.path))


class Rooms(LoadFileScheduling):
    """For `-n`: a file at a time in one worker; those that start ROS nodes one after the other, in the same one."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.split("::", 1)[0]
        return "ros" if _starts_nodes(self.config.rootpath / file) else file


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Rooms:
    """Files in the order of collection."""
    config.option.loadscopereorder = False
    return Rooms(config, log)


@functools.cache
def _starts_nodes(file: Path) -> bool:
    return "pytest.mark.ros" in file.read_text(encoding="utf-8")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """With a limit (`./sixstrut test --minutes`), what is not begun in time is skipped, and says so."""
    if time.monotonic() > _END:
        pytest.skip("the run's time is over")
