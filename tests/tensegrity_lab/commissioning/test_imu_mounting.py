# SPDX-License-Identifier: Apache-2.0
"""How the sensor sits, from the first look at its port to the file: at a virtual prototype, and by hand at a terminal."""

import math
import os
import threading
import tty

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hardware_bridge.errors import LinkLost
from hardware_bridge.imu.sensor_port import SensorPort
from hardware_bridge.imu.wt901 import GRAVITY_M_S2, Measurement, frames_of
from hardware_bridge.virtual_prototype.inertial_sensor import MOUNTED_OFF_RAD, turned_about
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.errors import ParameterError
from sim_core.sensing.face_filter import NAMES, box_share, shape_of
from sim_core.sensing.mounting import load_mounting
from sim_core.structure.parameters import load_prototype
from tensegrity_lab.commissioning.checks import Health
from tensegrity_lab.commissioning.imu_mounting import FACES, felt_up
from tensegrity_lab.commissioning.port_checks import check_sensor
from tests.sixstrut_cli.test_commands import sixstrut
from tests.tensegrity_lab.terminal import ENTER, Terminal

QUARTER = turned_about(np.array([0.0, 0.0, 1.0]), 0.5 * math.pi)


class Line:
    """A sensor on a pty that feels what it is told to: `up` in its own axes, `rate` of turn."""

    def __init__(self):
        self.near, far = os.openpty()
        tty.setraw(far)
        self._far, self.port = far, os.ttyname(far)
        self.up, self.rate = np.array([0.0, 0.0, GRAVITY_M_S2]), np.zeros(3)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self):
        while not self._ended.wait(0.005):
            os.write(self.near, frames_of(Measurement(tuple(self.up), tuple(self.rate))))

    def close(self):
        self._ended.set()
        self._thread.join()
        os.close(self._far)
        os.close(self.near)


@pytest.fixture
def line():
    line = Line()
    yield line
    line.close()


def test_a_sensor_at_rest_is_felt_and_one_that_turns_or_says_nothing_is_not(line):
    sensor = SensorPort(line.port)
    assert felt_up(sensor, 0.5) == pytest.approx(line.up, abs=0.01)
    line.up = 0.8 * line.up
    with pytest.raises(ParameterError, match="calibrate the sensor itself"):
        felt_up(sensor, 0.5)
    line.up, line.rate = line.up / 0.8, np.array([0.0, 0.5, 0.0])
    turner = threading.Timer(0.55, lambda: setattr(line, "rate", np.zeros(3)))
    turner.start()
    with pytest.raises(ParameterError, match="let it rest"):
        felt_up(sensor, 0.5)
    turner.join()
    with pytest.raises(ParameterError, match="are needed; set the sensor's return rate"):
        felt_up(sensor, 0.05)
    sensor.close()


def test_the_doctor_looks_at_a_sensor(line):
    (well,) = check_sensor(line.port)
    assert well.health is Health.FINE
    assert "m/s^2 at rest" in well.told
    line.up = 0.5 * line.up
    (ill,) = check_sensor(line.port)
    assert ill.health is Health.MEND
    (missing,) = check_sensor("/dev/no-such-sensor")
    assert (missing.what, missing.health) == ("sensor", Health.MEND)


@pytest.mark.slow
def test_a_person_puts_the_robot_on_face_after_face(tmp_path, line):
    person = Terminal("calibrate", "imu", "mine.yaml", "--port", line.port, folder=tmp_path)
    model, ups = build_model(load_prototype()), {}
    for face in (*FACES, "TO1"):
        robot = Robot.resting_on(model, face)
        shape = shape_of(robot.joints_m(), robot.box_m(), robot.quaternions()[-1], box_share(model))
        ups[face] = -GRAVITY_M_S2 * QUARTER.T @ shape.normals[NAMES.index(face)]
    try:
        for number, face in enumerate(FACES):
            person.says(f"Put the robot on {face}", limit_s=60)
            if number == 0:
                person.press("TC9", ENTER)
                person.says("TC9 is no face: valid are")
                person.says("Put the robot on TC6")
            if number == 4:
                person.press("-", ENTER)  # left out
                continue
            line.up = ups["TO1" if number == 5 else face]
            person.press("TO1" if number == 5 else "", ENTER)
        person.says("Written: mine.yaml", limit_s=60)
        assert person.ends() == 0
    finally:
        person.close()
    off = Rotation.from_matrix(QUARTER.T @ load_mounting(tmp_path / "mine.yaml")).magnitude()
    assert math.degrees(off) < 0.5


@pytest.mark.slow
def test_a_virtual_prototype_s_is_found_within_a_degree(tmp_path):
    told = sixstrut("calibrate", "imu", str(tmp_path / "mine.yaml"), "--virtual", limit_s=120)
    assert told.returncode == 0, told.stderr
    axis = np.random.default_rng([1, 2]).standard_normal(3)  # as the prototype of seed 1 draws it
    hidden = turned_about(axis / np.linalg.norm(axis), MOUNTED_OFF_RAD)
    off = Rotation.from_matrix(hidden.T @ load_mounting(tmp_path / "mine.yaml")).magnitude()
    assert math.degrees(off) < 1.0


def test_what_cannot_be_calibrated_is_refused(tmp_path):
    assert "give the sensor's port, or --virtual" in sixstrut("calibrate", "imu", str(tmp_path / "x.yaml")).stderr
    assert "a second one only after imu" in sixstrut("calibrate", str(tmp_path / "x.yaml"), str(tmp_path / "y.yaml")).stderr
    with pytest.raises(ParameterError, match="find it with"):
        load_mounting(tmp_path / "x.yaml")
    (tmp_path / "x.yaml").write_text("quaternion: [1, 1, 0, 0]\n")
    with pytest.raises(ParameterError, match="of length 1"):
        load_mounting(tmp_path / "x.yaml")


def test_a_port_that_ends_is_told(line):
    sensor = SensorPort(line.port)
    line.close()
    line.close = lambda: None
    with pytest.raises(LinkLost):
        felt_up(sensor, 0.5)
