# SPDX-License-Identifier: Apache-2.0
"""For all tests: how hypothesis draws, and an end to a run that has a limit."""

import os
import time

import pytest
from hypothesis import settings

from tests.scale import ALL

settings.register_profile("quick", derandomize=True, deadline=None, database=None)
settings.register_profile("all", deadline=None)
settings.load_profile("all" if ALL else "quick")

_END = time.monotonic() + 60.0 * float(os.environ.get("SIXSTRUT_TEST_MINUTES", "inf"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """With two workers: what starts ROS nodes comes first, one after the other in one of them; the rest a file at a time."""
    items.sort(key=lambda item: item.get_closest_marker("ros") is None)
    for item in items:
        item.add_marker(pytest.mark.xdist_group("ros" if item.get_closest_marker("ros") else str(item.path)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """With a limit (`./sixstrut test --minutes`), what is not begun in time is skipped, and says so."""
    if time.monotonic() > _END:
        pytest.skip("the run's time is over")
