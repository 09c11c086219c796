# SPDX-License-Identifier: Apache-2.0
"""Hands-free: trials judged and a travel made by an inertial sensor, as an experimenter runs them; the bag tells the same again."""

import json

import pytest

from hardware_bridge.recording.bag_on_disk import bags_in
from hardware_bridge.recording.bag_reader import read_session
from tests.sixstrut_cli.test_commands import sixstrut
from tests.tensegrity_lab.trials.test_trial import PLAN, VIRTUAL

pytestmark = [pytest.mark.slow, pytest.mark.ros, pytest.mark.timeout(600)]


def sources_of(bag):
    session = read_session(bag)
    return {m.source for m in session.of("bridge/face")}, len(list(session.of("bridge/observed_joints")))


def test_nobody_looks_at_trials_that_a_sensor_judges(tmp_path):
    folder = tmp_path / "s"
    told = sixstrut("trial", str(folder), "--judge", "imu", *PLAN, "--repeats", "2", *VIRTUAL, limit_s=500)
    assert told.returncode == 0, told.stdout + told.stderr
    assert "agrees with the sensor on 4 of 4 trials" in told.stdout
    (bag,) = bags_in(folder / "bags")
    assert sources_of(bag) == ({"imu"}, 0), "the stack heard no observer"
    again = sixstrut("trial", str(folder), "--virtual")
    assert "nothing: the session is complete" in again.stdout
    refused = sixstrut("trial", str(folder), "--virtual", "--judge", "hand")
    assert "has judge 'imu', not 'hand'" in refused.stderr
    replayed = sixstrut("replay", str(bag), "--json", limit_s=300)
    document = json.loads(replayed.stdout)
    assert replayed.returncode == 0, replayed.stderr
    assert document["imu"]["measurements"] > 1000
    assert document["imu"]["now"][-1] == document["imu"]["then"][-1]
    assert [face for face, settled in document["imu"]["now"] if settled] == [f for f, settled in document["imu"]["then"] if settled]


def test_it_travels_though_nobody_sees_it(tmp_path):
    words = ("0.25,0.1", "--imu", "--library", "continuous", "--time-scale", "2", "-o", str(tmp_path), "--json")
    told = sixstrut("travel", *words, limit_s=500)
    assert told.returncode == 0, told.stderr
    trip = json.loads(told.stdout)
    assert trip["success"]
    assert trip["seen_left_m"] < 0.2, "by the observer whom nobody heard"
    sources, seen = sources_of(next(iter(bags_in(tmp_path))))
    assert (sources, seen) == ({"imu"}, 0)
