# SPDX-License-Identifier: Apache-2.0
"""Constant-speed knots."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_core.gaits.strut_motion import constant_speed_knots

SPEED_M_S = 0.015
START = (0.234,) * 6
LENGTHS = st.tuples(*[st.integers(-45, 45).map(lambda mm: 0.234 + 1e-3 * mm)] * 6)


def test_each_strut_stops_at_its_own_time():
    target = (0.249, 0.264, 0.234, 0.204, 0.249, 0.234)
    knots = constant_speed_knots(START, target, speed_m_s=SPEED_M_S)
    assert [knot.time_s for knot in knots] == pytest.approx([1.0, 2.0])
    assert knots[0].lengths_m == pytest.approx((0.249, 0.249, 0.234, 0.219, 0.249, 0.234))
    assert knots[1].lengths_m == target


def test_a_stop_on_the_way_is_driven_to_whole_and_left_at_once():
    via, target = (0.249, *START[1:]), (0.249, 0.264, *START[2:])
    knots = constant_speed_knots(START, via, target, speed_m_s=SPEED_M_S)
    assert [(knot.time_s, knot.lengths_m) for knot in knots] == [(pytest.approx(1.0), via), (pytest.approx(3.0), target)]


def test_nothing_to_do_is_no_knot():
    assert constant_speed_knots(START, START, speed_m_s=SPEED_M_S) == ()


def test_struts_that_stop_almost_together_share_a_knot():
    knots = constant_speed_knots(START, (0.249, 0.249001, *START[2:]), speed_m_s=SPEED_M_S)
    assert len(knots) == 1
    assert knots[0].lengths_m == (0.249, 0.249001, *START[2:])


@given(LENGTHS, LENGTHS)
def test_no_strut_is_faster_than_the_actuators_and_all_arrive(start, target):
    knots = constant_speed_knots(start, target, speed_m_s=SPEED_M_S)
    assert len(knots) <= 6
    before_s, before = 0.0, start
    for knot in knots:
        assert knot.time_s > before_s
        for was, now in zip(before, knot.lengths_m, strict=True):
            assert abs(now - was) <= SPEED_M_S * (knot.time_s - before_s) + 1e-12
        before_s, before = knot.time_s, knot.lengths_m
    assert before == pytest.approx(target, abs=1e-12)


@given(LENGTHS, LENGTHS)
def test_every_strut_that_is_not_there_yet_drives_at_full_speed(start, target):
    before_s, before = 0.0, start
    for knot in constant_speed_knots(start, target, speed_m_s=SPEED_M_S):
        for was, now, end in zip(before, knot.lengths_m, target, strict=True):
            if abs(end - was) > SPEED_M_S * (knot.time_s - before_s):
                assert abs(now - was) == pytest.approx(SPEED_M_S * (knot.time_s - before_s))
        before_s, before = knot.time_s, knot.lengths_m
