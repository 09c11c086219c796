# SPDX-License-Identifier: Apache-2.0
"""When a bag is well enough to move the robot; when a strut is at rest."""

from types import SimpleNamespace
from typing import Any

import pytest

from hardware_bridge.recording.bag_monitor import STUCK_S, LogWatch, free_mb
from tensegrity_robot.bridge.observer import STILL_M, StillWatch


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


def watch_of(lengths, moved=()):
    """Whether the struts were still after each of the observations, 50 ms apart, of a first strut."""
    watch, still = StillWatch(), []
    for number, length in enumerate(lengths):
        watch.hear(50_000_000 * number, number in moved)
        watch.see(50_000_000 * number + 123, (length, *[0.234] * 5))
        still.append(watch.is_still)
    return still


def test_a_strut_is_still_half_a_second_after_its_last_change():
    assert watch_of([0.234 + 0.001 * min(number, 5) for number in range(20)]).index(True) == 15


def test_a_quiver_is_no_motion():
    assert watch_of([0.234 + 0.9 * STILL_M * (number % 2) for number in range(20)])[-1]


def test_what_was_seen_before_the_last_frame_does_not_count():
    still = watch_of([0.234] * 40, moved=(15,))
    assert still.index(False, 11) == 15
    assert still.index(True, 15) == 25


def test_a_late_observer_is_not_believed_to_see_the_present():
    watch = StillWatch()
    for number in range(20):
        watch.hear(50_000_000 * number, False)
        watch.see(50_000_000 * number, (0.234,) * 6)
    watch.hear(5_000_000_000, True)
    watch.hear(9_000_000_000, False)
    watch.see(2_000_000_000, (0.234,) * 6)
    assert not watch.is_still, "that was three seconds before the frame"
    assert not watch.is_after_last_frame
    watch.see(5_600_000_000, (0.234,) * 6)
    assert watch.is_still
    assert watch.is_after_last_frame


def test_an_observer_whose_clock_is_slow_is_believed_all_the_same():
    watch = StillWatch()
    for number in range(20_000):
        watch.hear(50_000_000 * number, False)
        watch.see(round(50_000_000 * number * (1 - 5e-4)), (0.234,) * 6)
    watch.hear(50_000_000 * 20_000, True)
    watch.hear(50_000_000 * 20_001, False)
    watch.see(round(50_000_000 * 20_001 * (1 - 5e-4)), (0.234,) * 6)
    assert watch.is_after_last_frame


def test_an_observer_that_nobody_can_compare_is_believed():
    assert StillWatch().is_after_last_frame
