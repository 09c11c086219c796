# SPDX-License-Identifier: Apache-2.0
"""When a bag is well enough to move the robot."""

from types import SimpleNamespace
from typing import Any

import pytest

from hardware_bridge.recording.log_watch import STUCK_S, LogWatch, free_mb


@pytest.fixture
def log(tmp_path) -> Any:
    """What a watch needs of a log."""
    return SimpleNamespace(path=tmp_path / "a.mcap", fault="", messages=0, waiting=0)


def test_a_log_with_room_that_grows_is_well(log):
    watch = LogWatch(log, 1.0)
    for second in range(10):
        log.messages, log.waiting = 10 * second, 3
        assert watch.look(float(second)) == ""
    assert watch.free_mb == pytest.approx(free_mb(log.path.parent), rel=0.5)


def test_a_log_to_which_nothing_happens_is_well(log):
    watch = LogWatch(log, 1.0)
    assert [watch.look(float(second)) for second in range(10)] == [""] * 10


def test_a_dead_log_says_why(log):
    watch = LogWatch(log, 1.0)
    log.fault = "writing failed (File too large)"
    assert watch.look(0.0).startswith("the log is dead (writing failed (File too large)): start the bridge again")


def test_too_little_space_names_folder_limit_and_parameter(log):
    watch = LogWatch(log, 200.0, lambda folder: 12.3)
    assert f"12 MB are free in {log.path.parent}, the limit is 200 MB (space_limit_mb)" in watch.look(0.0)


def test_a_disk_that_is_gone_is_trouble(log, tmp_path):
    log.path = tmp_path / "gone" / "a.mcap"
    assert "No such file" in LogWatch(log, 1.0).look(0.0)


def test_messages_that_wait_while_none_is_written_are_trouble_until_one_is(log):
    watch = LogWatch(log, 1.0)
    log.messages = 5
    assert watch.look(0.0) == ""
    log.waiting = 7
    assert watch.look(STUCK_S / 2) == ""
    assert "has not grown" in watch.look(2 * STUCK_S)
    assert "7 messages wait" in watch.trouble
    log.messages = 6
    assert watch.look(2 * STUCK_S + 0.1) == ""
