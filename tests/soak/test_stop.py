# SPDX-License-Identifier: Apache-2.0
"""Stop, again and again, while the log is written and a rehearsal loads all cores."""

import pytest

from tests.failures.command_failures import STOP_LIMIT_MS, rehearsing, stop_times_ms
from tests.failures.rig import STRUTS, percentile

pytestmark = [pytest.mark.soak, pytest.mark.ros, pytest.mark.timeout(3600)]

STOPS = 200


def test_the_last_bytes_go_out_within_50_ms_of_99_stops_in_100(lab, figure):
    lab.use(STRUTS)
    with rehearsing(lab):
        times_ms = stop_times_ms(lab, STOPS)
    for part in (0.5, 0.95, 0.99, 1.0):
        figure(f"stop to last bytes, {part * 100:g} % of {STOPS} [ms]", round(percentile(times_ms, part), 1))
    assert percentile(times_ms, 0.99) <= STOP_LIMIT_MS
