# SPDX-License-Identifier: Apache-2.0
"""A command is as old as it is when it is accepted."""

import math

import pytest

from hardware_bridge.safety.command_age import Age


@pytest.mark.parametrize(
    ("on_receipt_s", "judged_s", "age_s"),
    [(0.0, 0.0, 0.0), (0.1, 3.2, 3.3), (-0.2, 0.1, -0.2), (-3.0, 3.0, -3.0), (-0.3, 3.3, 3.0), (0.6, 0.0, 0.6)],
)
def test_judging_makes_it_older_and_nothing_makes_it_younger(on_receipt_s: float, judged_s: float, age_s: float) -> None:
    now_s = [100.0]
    age = Age(on_receipt_s, lambda: now_s[0])
    now_s[0] += judged_s
    assert age.now_s() == pytest.approx(age_s)


def test_no_stamp_is_no_age() -> None:
    assert math.isnan(Age(math.nan).now_s())
