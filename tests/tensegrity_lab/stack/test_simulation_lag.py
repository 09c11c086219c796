# SPDX-License-Identifier: Apache-2.0
"""How late a virtual prototype is."""

from dataclasses import replace

import numpy as np
import pytest

from hardware_bridge.prototype_client.observation import Observation
from tensegrity_lab.stack import simulation_lag
from tensegrity_lab.stack.simulation_lag import Lateness, LateOrders


def test_late_is_what_comes_later_than_the_best_so_far(monkeypatch):
    clock = iter([100.0, 101.0, 102.5, 103.0])
    monkeypatch.setattr(simulation_lag.time, "monotonic", lambda: next(clock))
    late = Lateness(time_scale=8.0)
    told = []
    for robot_s in (0, 8, 16, 24):
        late.saw(robot_s * 1_000_000_000)
        told.append(late.late_s)
    assert told == pytest.approx([0.0, 0.0, 0.5, 0.0])


def test_orders_are_too_late_above_a_limit_until_it_is_forgotten():
    seen = Observation(0, "TC1", "", True, np.zeros((12, 3)), np.zeros(3))
    late = LateOrders()
    late.saw(replace(seen, late_s=0.9))
    assert late.too_late(8.0) == ""
    late.saw(replace(seen, late_s=1.5))
    late.saw(seen)
    assert late.too_late(8.0).startswith("the virtual prototype took its orders 1.5 s of robot time late")
    assert late.too_late(8.0).endswith("too busy for --time-scale 8; lower it")
    late.forget()
    assert late.too_late(8.0) == ""
