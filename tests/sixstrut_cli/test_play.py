"""Playing a bag into ROS: a twin that follows ends with the replay's bits, and a living bridge is left alone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hardware_bridge.bag_reader import read_session
from sixstrut_cli.playing import TOLD
from sixstrut_cli.replaying import replay
from tensegrity_interfaces.msg import StrutsSent
from tensegrity_robot import qos

EXAMPLE = Path(__file__).parents[2] / "bags" / "example.mcap"


def play(domain, *words):
    environ = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    command = [sys.executable, "-m", "sixstrut_cli", "play", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False, env=environ)


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


def test_nothing_that_is_played_is_heard_by_a_bridge():
    heard_by_the_bridge = {"bridge/lease", "twin/state", "twin/face", "twin/joint_states"}
    assert not heard_by_the_bridge & set(TOLD)


def test_what_is_no_bag_is_one_line(tmp_path):
    result = play(100, str(tmp_path / "none.mcap"))
    assert result.returncode == 1
    assert "cannot read bag" in result.stderr
