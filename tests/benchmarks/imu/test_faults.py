# SPDX-License-Identifier: Apache-2.0
"""The bench of faulty sensors spoils what it says, and counts what is said of it."""

import pytest

from tests.benchmarks.imu.faults import FAULTS, mounted, spoilt, tables


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_sensor_says_something_and_nothing_wrong(name):
    own, wrong, words = spoilt((name, 5))
    assert (own, wrong) == (name, 0)
    assert words > 0


def test_a_mounting_is_found_within_a_degree():
    assert mounted(3) < 1.0


@pytest.mark.slow
def test_the_tables_name_every_fault_and_the_mountings():
    text = tables(1, 2, 1, 1)
    assert all(name in text for name in FAULTS)
    assert "on 2 hidden robots, is off by: median" in text
