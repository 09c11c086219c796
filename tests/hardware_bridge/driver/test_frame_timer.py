# SPDX-License-Identifier: Apache-2.0
import threading
import time

from hardware_bridge.driver.frame_timer import Streamer
from tests.hardware_bridge.helpers import wait_for


def test_deadlines_are_absolute_so_that_periods_do_not_add_up_errors() -> None:
    times: list[float] = []
    late: list[int] = []

    def tick(missed: int) -> None:
        times.append(time.monotonic())
        late.append(missed)

    start = time.monotonic()
    streamer = Streamer(tick, lambda error: None, 0.01)
    streamer.start()
    wait_for(lambda: len(times) >= 30, "thirty ticks")
    streamer.stop()
    for count, moment in enumerate(times, start=1):
        assert moment >= start + 0.01 * (count + sum(late[:count])) - 1e-3


def test_missed_deadlines_are_counted_and_dropped() -> None:
    calls: list[int] = []

    def tick(missed: int) -> None:
        calls.append(missed)
        if len(calls) == 1:
            threading.Event().wait(0.1)

    streamer = Streamer(tick, lambda error: None, 0.01)
    streamer.start()
    wait_for(lambda: len(calls) >= 3, "three ticks")
    streamer.stop()
    assert calls[1] >= 8


def test_a_failing_tick_is_told_and_the_loop_goes_on() -> None:
    failures: list[Exception] = []

    def tick(missed: int) -> None:
        raise ZeroDivisionError

    streamer = Streamer(tick, failures.append, 0.005)
    streamer.start()
    wait_for(lambda: len(failures) >= 3, "three failures")
    streamer.stop()
    assert all(isinstance(error, ZeroDivisionError) for error in failures)
