# SPDX-License-Identifier: Apache-2.0
"""Playing a bag into ROS: a twin that follows ends with the replay's bits, and a living bridge is left alone."""

import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions

from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.bag_types import TOPICS
from tensegrity_interfaces.msg import StrutsSent
from tensegrity_lab.bags import play as playing
from tensegrity_lab.bags.play import TOLD, filled
from tensegrity_lab.bags.replay import replay
from tensegrity_lab.stack.message_types import message_class
from tensegrity_robot.ros import qos
from tensegrity_robot.ros.cdr import wire_bytes

EXAMPLE = Path(__file__).parents[3] / "bags" / "example"


def play(domain, *words):
    environ = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    command = [sys.executable, "-m", "sixstrut_cli", "play", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False, env=environ)


@pytest.mark.slow
@pytest.mark.ros
def test_the_twin_that_follows_ends_with_the_bits_of_the_replay():
    result = play(102, str(EXAMPLE), "--rate", "4")
    assert result.returncode == 0, result.stderr
    digest = re.search(r"state ([0-9a-f]{64})", result.stdout)[1]
    assert digest == replay(read_session(EXAMPLE)).digest


@pytest.mark.ros
def test_beside_a_bridge_nothing_is_played():
    context = Context()
    rclpy.init(context=context, domain_id=101, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("a_bridge", context=context)
    node.create_publisher(StrutsSent, "bridge/struts_sent", qos.STREAM)
    try:
        result = play(101, str(EXAMPLE))
    finally:
        node.destroy_node()
        context.try_shutdown()
    assert result.returncode == 1
    assert "a bridge is running: nothing is played beside it" in result.stderr


def test_an_old_message_becomes_one_of_today_with_defaults_for_what_it_does_not_have():
    session = read_session(EXAMPLE, topics=TOLD)
    for topic, all_of_it in session.messages.items():
        kind = message_class(TOPICS[topic][0] if topic in TOPICS else "sensor_msgs/msg/JointState")
        old = all_of_it[len(all_of_it) // 2].message
        today = deserialize_message(wire_bytes(filled(kind, old)), kind)
        assert today == filled(kind, old)
        if topic == "bridge/struts_sent":
            assert not hasattr(old, "session")
            assert today.session == ""
            assert (today.seq, today.robot_time_ns, bytes(today.frame)) == (old.seq, old.robot_time_ns, bytes(old.frame))
            assert list(today.length_m) == list(old.length_m)
        if topic == "bridge/asked":
            assert [list(point.positions) for point in today.points] == [list(point.positions) for point in old.points]


def test_pauses_and_log_times_from_anywhere_are_no_time_to_wait(monkeypatch):
    session = read_session(EXAMPLE, topics=("bridge/face",))
    (face, *_) = session.messages["bridge/face"]
    due = [face._replace(log_time_ns=number * 10**18) for number in range(4)]
    waited, heard = [], []
    monkeypatch.setattr(playing.time, "sleep", waited.append)
    publisher = SimpleNamespace(publish=heard.append)
    types = {"bridge/face": "tensegrity_interfaces/msg/FaceObservation"}
    assert playing._publish(due, {"bridge/face": publisher}, types, 1.0, lambda done, total: None) == 4
    assert len(heard) == 4
    assert all(wait <= 3 * playing.MOST_PAUSE_S for wait in waited)


def test_nothing_that_is_played_is_heard_by_a_bridge():
    heard_by_the_bridge = {"bridge/lease", "twin/state", "twin/face", "twin/joint_states"}
    assert not heard_by_the_bridge & set(TOLD)


def test_what_is_no_bag_is_one_line(tmp_path):
    result = play(100, str(tmp_path / "none.mcap"))
    assert result.returncode == 1
    assert "cannot read bag" in result.stderr
