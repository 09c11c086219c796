# SPDX-License-Identifier: Apache-2.0
import math

from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order, Outputs


def test_the_first_order_jumps_whatever_it_asks() -> None:
    outputs = Outputs()
    assert math.isnan(outputs.pulse_us(1, 0.0))
    outputs.follow(Order({1: 1800}, 5.0), 1.0)
    assert outputs.pulse_us(1, 1.0) == 1800
    assert not outputs.is_moving(1.0)


def test_later_orders_go_straight_from_where_the_output_is() -> None:
    outputs = Outputs()
    outputs.follow(Order({1: 1500}, 0.0), 0.0)
    outputs.follow(Order({1: 1600}, 1.0), 0.0)
    assert outputs.pulse_us(1, 0.25) == 1525
    outputs.follow(Order({1: 1500}, 0.5), 0.5)
    assert outputs.pulse_us(1, 0.5) == 1550
    assert outputs.pulse_us(1, 0.75) == 1525
    assert outputs.is_moving(0.75)
    assert outputs.pulse_us(1, 9.0) == 1500


def test_a_channel_without_a_pulse_forgets() -> None:
    outputs = Outputs()
    outputs.follow(Order({1: 1500}, 0.0), 0.0)
    outputs.follow(Order({1: None}), 1.0)
    assert outputs.channels == ()
    assert math.isnan(outputs.pulse_us(1, 1.0))
    outputs.follow(Order({1: 1900}, 5.0), 2.0)
    assert outputs.pulse_us(1, 2.0) == 1900
