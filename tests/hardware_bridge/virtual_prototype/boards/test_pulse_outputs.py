# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import pytest

from hardware_bridge.virtual_prototype.boards.pulse_outputs import Freeze, Off, Order, Outputs, Paced, Reset, Timed


@pytest.mark.parametrize("first", [Timed((1,), (1800,), 5.0), Paced(1, 1800, 25.0)])
def test_the_first_order_jumps_whatever_it_asks(first: Order) -> None:
    outputs = Outputs()
    assert math.isnan(outputs.pulse_us(1, 0.0))
    outputs.follow(first, 1.0)
    assert outputs.pulse_us(1, 1.0) == 1800
    assert not outputs.is_moving(1.0)


def test_later_orders_go_straight_from_where_the_output_is() -> None:
    outputs = Outputs()
    outputs.follow(Timed((1,), (1500,), 0.0), 0.0)
    outputs.follow(Timed((1,), (1600,), 1.0), 0.0)
    assert outputs.pulse_us(1, 0.25) == 1525
    outputs.follow(Timed((1,), (1500,), 0.5), 0.5)
    assert outputs.pulse_us(1, 0.5) == 1550
    assert outputs.pulse_us(1, 0.75) == 1525
    assert outputs.is_moving(0.75)
    assert outputs.pulse_us(1, 9.0) == 1500


def test_a_pace_is_kept_and_none_is_at_once() -> None:
    outputs = Outputs()
    outputs.follow(Paced(1, 1500, 0.0), 0.0)
    outputs.follow(Paced(1, 1600, 200.0), 0.0)
    assert outputs.pulse_us(1, 0.25) == 1550
    assert outputs.pulse_us(1, 0.5) == 1600
    outputs.follow(Paced(1, 1000, 0.0), 1.0)
    assert outputs.pulse_us(1, 1.0) == 1000


@pytest.mark.parametrize("order", [Off((1,)), Reset()])
def test_a_channel_without_a_pulse_forgets(order: Order) -> None:
    outputs = Outputs()
    outputs.follow(Timed((1,), (1500,), 0.0), 0.0)
    outputs.follow(order, 1.0)
    assert math.isnan(outputs.pulse_us(1, 1.0))
    outputs.follow(Timed((1,), (1900,), 5.0), 2.0)
    assert outputs.pulse_us(1, 2.0) == 1900


def test_a_frozen_channel_stays_where_it_is() -> None:
    outputs = Outputs()
    outputs.follow(Freeze(1), 0.0)
    assert math.isnan(outputs.pulse_us(1, 0.0))
    outputs.follow(Timed((1,), (1500,), 0.0), 0.0)
    outputs.follow(Timed((1,), (1600,), 1.0), 0.0)
    outputs.follow(Freeze(1), 0.5)
    assert outputs.pulse_us(1, 9.0) == 1550
