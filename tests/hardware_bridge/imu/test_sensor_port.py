# SPDX-License-Identifier: Apache-2.0
"""A sensor's port: when measurements were made, whatever the link does to them; real bytes on a pty."""

import os
import tty
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.errors import LinkLost, PortMissing
from hardware_bridge.imu.sensor_port import EvenStamps, SensorPort
from hardware_bridge.imu.wt901 import GRAVITY_M_S2, Measurement, frames_of

PERIOD_S = 0.01
MADE_S = np.arange(1000) * PERIOD_S
LATE_S = np.maximum.accumulate(MADE_S + 0.002 + np.random.default_rng(0).exponential(0.003, len(MADE_S)))
UPRIGHT = Measurement((0.0, 0.0, GRAVITY_M_S2), (0.0, 0.0, 0.1))


def stamped(came_s):
    stamps = EvenStamps()
    return np.array([stamps.stamp(float(came)) for came in came_s])


def test_jitter_of_the_link_is_taken_out():
    stamps = stamped(LATE_S)[300:]
    assert np.diff(LATE_S)[300:].std() > 0.002
    assert np.diff(stamps).std() < 0.0005
    assert np.abs(stamps - MADE_S[300:] - 0.005).max() < 0.005


def test_what_a_link_holds_back_keeps_its_times():
    came = np.where((MADE_S > 5.0) & (MADE_S < 5.4), 5.41, LATE_S)
    stamps = stamped(np.maximum.accumulate(came))
    held = (MADE_S > 4.9) & (MADE_S < 6.0)
    assert np.diff(stamps)[held[1:]].max() < 2.0 * PERIOD_S, "no gap is seen"
    assert np.abs(stamps - MADE_S)[held].max() < 0.1


def test_what_a_link_loses_is_seen_as_a_gap():
    kept = ~((MADE_S > 5.0) & (MADE_S < 5.4))
    stamps = stamped(LATE_S[kept])
    assert np.diff(stamps).max() > 0.35
    assert np.abs(stamps - MADE_S[kept])[-300:].max() < 0.03


@given(st.lists(st.floats(0.0, 2.0), min_size=1, max_size=200))
def test_times_go_on_whatever_comes(intervals):
    came = np.cumsum(intervals)
    stamps = stamped(came)
    assert (np.diff(stamps) > 0.0).all()
    assert (stamps <= came + 0.5 + 1e-3).all(), "none is far ahead of when it came"


@pytest.fixture
def line():
    near, far = os.openpty()
    tty.setraw(far)
    yield near, os.ttyname(far)
    os.close(far)
    with suppress(OSError):  # the test may have closed it
        os.close(near)


def test_measurements_are_read_and_what_waited_before_is_not(line):
    near, port = line
    os.write(near, 50 * frames_of(UPRIGHT))
    sensor = SensorPort(port)
    assert sensor.read(0.05) == []
    os.write(near, b"\x55\x51noise" + 3 * frames_of(UPRIGHT))
    told = [measurement for _ in range(3) for _, measurement in sensor.read(0.2)]
    assert len(told) == sensor.measurements == 2, "a round is over when the next one begins"
    assert told[0].acceleration_m_s2 == pytest.approx(UPRIGHT.acceleration_m_s2)
    assert told[0].rate_rad_s == pytest.approx(UPRIGHT.rate_rad_s, abs=1e-3)
    assert sensor.bad_bytes >= 7
    sensor.close()


def test_a_sensor_that_is_unplugged_is_lost(line):
    near, port = line
    sensor = SensorPort(port)
    os.close(near)
    with pytest.raises(LinkLost):
        sensor.read(0.2)
    sensor.close()
    with pytest.raises(PortMissing):
        SensorPort("/dev/no-such-sensor")
