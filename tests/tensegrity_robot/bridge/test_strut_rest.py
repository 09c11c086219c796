# SPDX-License-Identifier: Apache-2.0
"""When a strut is at rest."""

from tensegrity_robot.bridge.strut_rest import STILL_M, StillWatch


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
