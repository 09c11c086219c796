# SPDX-License-Identifier: Apache-2.0
"""What TF and RViz's RobotModel are told of a twin below a namespace: every link of its URDF, and where it is."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.serialization import serialize_message
from tf2_msgs.msg import TFMessage

from sim_core.sensing.mounting import load_mounting
from sim_core.structure.rotations import matrix_of
from tensegrity_lab.stack.processes import wait_until
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.conversions import cdr_string
from tensegrity_robot.ros.node_process import own_context

pytestmark = pytest.mark.ros


@pytest.fixture
def viewer(domain):
    context = own_context(domain)
    spinner = Spinner(Node("viewer", namespace="blue", context=context), context)
    yield spinner.node
    spinner.close()
    context.try_shutdown()


def stamp(header):
    return header.stamp.sec, header.stamp.nanosec


def turn(q):
    return matrix_of(np.array([q.w, q.x, q.y, q.z]))


def place(point):
    return np.array([point.x, point.y, point.z])


def test_every_link_of_the_urdf_is_where_the_twin_has_it(processes, viewer, tmp_path):
    frames, joints, poses, descriptions = {}, {}, {}, []
    topics.FRAMES.subscribe(viewer, lambda m: frames.setdefault(stamp(m.transforms[0].header), m))
    topics.TWIN_JOINTS.subscribe(viewer, lambda m: joints.setdefault(stamp(m.header), m))
    topics.TWIN_POSE.subscribe(viewer, lambda m: poses.setdefault(stamp(m.header), m))
    mounting = tmp_path / "mounting.yaml"
    mounting.write_text("quaternion: [0.8, 0.6, 0.0, 0.0]\n", encoding="utf-8")
    processes.node("twin", "--ros-args", "-r", "__ns:=/blue", mode="standalone", mounting=mounting)
    wait_until(lambda: set(frames) & set(joints) & set(poses), 60.0, "the frames of a state")
    topics.ROBOT_DESCRIPTION.subscribe(viewer, descriptions.append)  # long after it was published
    wait_until(lambda: descriptions, 20.0, "the description, for a late joiner")

    at = sorted(set(frames) & set(joints) & set(poses))[0]
    seen, body = joints[at], poses[at]
    root, *links = frames[at].transforms
    assert {stamp(transform.header) for transform in (root, *links)} == {at}
    assert (root.header.frame_id, root.child_frame_id) == ("blue/odom", "blue/base_link")
    assert seen.header.frame_id == body.header.frame_id == "blue/odom"
    assert {link.header.frame_id for link in links if link.child_frame_id != "blue/imu_link"} == {"blue/base_link"}

    robot = ElementTree.fromstring(descriptions[0].data)
    told = {link.child_frame_id: link.transform for link in links}
    assert {"blue/base_link", *told} == {link.get("name") for link in robot.findall("link")}
    base, shift = turn(root.transform.rotation), place(root.transform.translation)
    for node in range(12):
        in_odom = shift + base @ place(told[f"blue/N{node + 1}"].translation)
        assert in_odom == pytest.approx(place(seen.poses[node].position), abs=1e-9)
        whole = base @ turn(told[f"blue/N{node + 1}"].rotation)
        assert whole == pytest.approx(turn(seen.poses[node].orientation), abs=1e-9)
    assert shift + base @ place(told["blue/box"].translation) == pytest.approx(place(seen.poses[12].position), abs=1e-9)
    (imu,) = (link for link in links if link.child_frame_id == "blue/imu_link")
    assert imu.header.frame_id == "blue/box"
    assert turn(imu.transform.rotation) == pytest.approx(load_mounting(mounting), abs=1e-9), "as it was found to sit"
    for joint in robot.findall(
        "joint[@type='floating']"
    ):  # at rest on a face the shape is the ideal one but for a centimetre or two
        ideal = [float(word) for word in joint.find("origin").get("xyz").split()]
        assert place(told[joint.find("child").get("link")].translation) == pytest.approx(ideal, abs=0.02)


def test_frames_of_a_robot_whose_name_ends_like_the_own_one_are_not_the_own():
    one = TFMessage(transforms=[TransformStamped(child_frame_id="a/base_link")])
    other = TFMessage(transforms=[TransformStamped(child_frame_id="aa/base_link")])
    own = cdr_string("a/base_link")
    assert own in serialize_message(one)
    assert own not in serialize_message(other)
