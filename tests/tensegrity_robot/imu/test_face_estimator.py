# SPDX-License-Identifier: Apache-2.0
"""Faces told by an inertial sensor in the box: real bytes, real processes; and what makes the face unknown."""

import numpy as np
import pytest
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu

from hardware_bridge.prototype_client.fault_client import inject
from hardware_bridge.prototype_client.handshake import imu_path
from tensegrity_interfaces.msg import StrutsSent
from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros import topics

pytestmark = pytest.mark.ros

SCALE = 4.0
LEVEL = ("--perturbation", "0", "--actuators", "ideal")


@pytest.fixture
def sensed(processes, operator):
    """A robot whose faces nobody sees; its sensor sits as its axes say but for five degrees."""
    prototype = processes.node("virtual_prototype", "--imu", "wt901", "--time-scale", f"{SCALE:g}", *LEVEL)
    prototype.says("ready")
    processes.node("twin")
    processes.node("gait_planner", rehearse_members=0)
    operator.estimator = processes.node("face_estimator")
    operator.driver = processes.node("imu_driver")
    processes.node("hardware_bridge", record=False, observer="none").says("DISARMED, nothing moves")
    operator.link = processes.folder / "state" / "prototype"
    operator.estimates, operator.measured = [], []
    topics.FACE_ESTIMATE.subscribe(operator.node, operator.estimates.append)
    topics.IMU_DATA.subscribe(operator.node, operator.measured.append)
    operator.wait_for_stack()
    return operator


def told(operator, face, settled=True):
    seen = lambda: operator.observed is not None and (operator.observed.face, operator.observed.settled) == (face, settled)  # noqa: E731
    operator.wait(seen, f"{face or 'no face'} by the sensor (now {operator.observed})", 30.0)
    assert operator.observed.source == "imu"
    return operator.observed.detail


def test_it_is_told_from_nothing_and_a_roll_is_confirmed_without_a_person(sensed):
    assert told(sensed, "TC6").endswith("%")
    sensed.wait(lambda: sensed.estimates and max(sensed.estimates[-1].probability) >= 0.99, "a sure estimate", 20.0)
    estimate = sensed.estimates[-1]
    assert sum(estimate.probability) <= 1.0
    message = sensed.measured[-1]
    assert message.header.frame_id == "imu_link"
    assert message.orientation_covariance[0] == -1.0
    up = message.linear_acceleration
    assert np.linalg.norm((up.x, up.y, up.z)) == pytest.approx(9.8, abs=0.6)
    sensed.arm([0.234] * 6)
    result = sensed.roll("TO5")
    assert result.success, result.reason
    assert result.observed_face == "TO5"
    assert list(result.face_sequence) == ["TC6", "TO5"]
    assert told(sensed, "TO5").endswith("%")


@pytest.mark.slow
def test_unplugged_in_a_motion_the_face_is_unknown_until_it_is_back(sensed):
    told(sensed, "TC6")
    sensed.arm([0.234] * 6)
    handle = sensed.begin_roll("TO5")
    sensed.moves(handle, 0.01)
    inject(sensed.link, "imu_unplugged")
    assert "no measurement came for" in told(sensed, "", settled=False)
    sensed.driver.says("trying again each second")
    inject(sensed.link, "clear")
    result = sensed.end(handle, 60.0).result
    assert result.success, result.reason
    assert result.observed_face == "TO5", "the flat prior is enough at rest"


@pytest.mark.slow
def test_unplugged_at_rest_it_is_missed_when_struts_move_and_a_person_is_waited_for(sensed):
    told(sensed, "TC6")
    sensed.arm([0.234] * 6)
    told(sensed, "TC6")
    inject(sensed.link, "imu_unplugged")
    sensed.driver.says("trying again each second")
    assert sensed.observed.face == "TC6", "nothing has moved"
    handle = sensed.begin_roll("TO5")
    assert "while the struts moved" in told(sensed, "", settled=False)
    sensed.wait(lambda: sensed.feedback[-1].startswith("waiting for somebody"), "a question to a person", 60.0)
    sensed.set_face("TO5")
    result = sensed.end(handle, 60.0).result
    assert result.success, result.reason


@pytest.mark.slow
def test_turned_in_its_mount_it_is_not_believed_until_somebody_says_the_face_and_it_agrees(sensed):
    told(sensed, "TC6")
    inject(sensed.link, "imu_turned", degrees=50.0)
    assert "Say the face" in told(sensed, "", settled=False)
    sensed.set_face("TC6")
    wait_until(lambda: sensed.observed.source == "operator", 10.0, "the person's word")
    count = len(sensed.estimates)
    sensed.wait(lambda: len(sensed.estimates) > count + 20, "two seconds of estimates", 20.0)
    assert sensed.estimates[-1].doubt
    assert sensed.observed.source == "operator", "the sensor says nothing against it"


@pytest.mark.parametrize("kind", ["two", "recorded", "strange"])
def test_a_second_sensor_a_recording_or_a_strange_session_makes_the_face_unknown_with_a_warning(sensed, kind):
    told(sensed, "TC6")
    if kind == "strange":
        stranger = topics.STRUTS_SENT.publisher(sensed.node)
        sensed.node.create_timer(0.2, lambda: stranger.publish(StrutsSent(session="another", heartbeat=True)))
    else:
        other = sensed.node.create_publisher(Imu, "imu/data", QoSProfile(depth=10))
    if kind == "recorded":
        sensed.driver.signal(2)
        sensed.driver.ends()
        message = sensed.measured[0]
        message.header.stamp.sec -= 100
        sensed.node.create_timer(0.05, lambda: other.publish(message))
    words = {
        "two": "2 sensors publish on imu/data: end all but one",
        "recorded": "a recording is played, or clocks differ",
        "strange": "session another is another bridge's, or a recording",
    }[kind]
    assert words in told(sensed, "", settled=False)
    sensed.estimator.says(words)


def test_the_driver_waits_for_a_port_that_is_not_there_and_tells_its_health(processes, operator):
    processes.node("imu_driver", port="/dev/no-such-sensor").says("trying again each second")
    operator.wait(lambda: "imu_driver: sensor" in operator.diagnostics, "its health", 20.0)
    assert "does not" in operator.diagnostics["imu_driver: sensor"].message
    assert not imu_path(processes.folder / "state" / "prototype").exists()
