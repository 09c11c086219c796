# SPDX-License-Identifier: Apache-2.0
"""The inertial sensor of a virtual prototype, at its own port: what it sends, and how it fails."""

import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest

from hardware_bridge.errors import LinkLost, PrototypeError
from hardware_bridge.imu.sensor_port import SensorPort
from hardware_bridge.imu.wt901 import GRAVITY_M_S2
from hardware_bridge.prototype_client.fault_client import inject
from hardware_bridge.prototype_client.handshake import imu_path
from hardware_bridge.virtual_prototype.practice import practice_prototype
from tensegrity_lab.stack.processes import wait_until


@pytest.fixture(scope="module")
def link():
    with practice_prototype(more={"imu": "wt901", "seed": 3}) as link:
        yield link


def heard(sensor, count):
    told = []
    wait_until(lambda: told.extend(sensor.read(0.1)) or len(told) >= count, 30.0, f"{count} measurements")
    return told


def up_of(told):
    return np.array([measurement.acceleration_m_s2 for _, measurement in told]).mean(axis=0)


def test_at_rest_it_feels_gravity_with_noise_a_hundred_times_a_second(link):
    with closing(SensorPort(str(imu_path(link)))) as sensor:
        told = heard(sensor, 200)
    up = np.array([measurement.acceleration_m_s2 for _, measurement in told])
    assert np.linalg.norm(up.mean(axis=0)) == pytest.approx(GRAVITY_M_S2, abs=0.05)
    assert 0.02 < up.std(axis=0).max() < 0.3
    times = np.array([made_s for made_s, _ in told])
    assert np.median(np.diff(times[100:])) == pytest.approx(0.01, rel=0.2)


def test_it_freezes_turns_and_vanishes_as_it_is_told(link):
    port = str(imu_path(link))
    with closing(SensorPort(port)) as sensor:
        before = up_of(heard(sensor, 100))
        inject(link, "imu_frozen")
        wait_until(
            lambda: len({measurement for _, measurement in heard(sensor, 10)}) == 1, 30.0, "the same figures again and again"
        )
        inject(link, "clear")
        wait_until(lambda: len({measurement for _, measurement in heard(sensor, 10)}) > 5, 30.0, "figures that differ")
        inject(link, "imu_turned", degrees=60.0)
        cosine = up_of(heard(sensor, 100)[50:]) @ before / GRAVITY_M_S2**2
        assert cosine < 0.99
        inject(link, "imu_unplugged")
        with pytest.raises(LinkLost):
            heard(sensor, 1000)
    assert not imu_path(link).exists()
    inject(link, "clear")
    with closing(SensorPort(port)) as sensor:
        heard(sensor, 10)


def test_without_one_its_faults_are_refused():
    with practice_prototype() as link:
        with pytest.raises(PrototypeError, match="start the prototype with --imu"):
            inject(link, "imu_frozen")
        assert not imu_path(link).exists()


def test_a_prototype_that_cannot_start_leaves_no_port_of_its_sensor(tmp_path):
    (tmp_path / "prototype").write_text("somebody's file", encoding="utf-8")
    words = [sys.executable, "-m", "hardware_bridge.virtual_prototype", "--link", str(tmp_path / "prototype"), "--imu", "wt901"]
    told = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert told.returncode == 1
    assert "is no link of ours" in told.stderr
    assert not imu_path(tmp_path / "prototype").is_symlink()
