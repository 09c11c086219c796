# SPDX-License-Identifier: Apache-2.0
"""Somebody who says too much: one message as fast as the computer can, until the process is ended, or one motion of many points.

python tests/failures/flood.py bridge/lease tensegrity_interfaces/msg/LeaseProof
python tests/failures/flood.py twin/markers visualization_msgs/msg/MarkerArray 100000     # bytes of text in each
python tests/failures/flood.py execute_struts 300000                                       # points; says the reason
"""

import sys
import time
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sim_core.names import STRUT_NAMES
from tensegrity_interfaces.action import ExecuteStruts
from tensegrity_lab.stack.message_types import message_class

LATE_S = 20.0


def flooding(kind: Any, size: int) -> bytes:
    """A message of a type, with `size` bytes of text in it where the type has a place for them."""
    message = kind()
    if hasattr(message, "header"):
        message.header.frame_id = "x" * size
    elif hasattr(message, "markers"):
        from visualization_msgs.msg import Marker

        message.markers = [Marker(text="x" * size)]
    elif hasattr(message, "data"):
        message.data = "x" * size
    return bytes(serialize_message(message))


def send_points(count: int) -> None:
    """Send one motion; says "flooding" before, and why it was refused."""
    node = Node("flood")
    client = ActionClient(node, ExecuteStruts, "execute_struts")
    if not client.wait_for_server(LATE_S):
        sys.exit("nobody offers execute_struts")
    points = [JointTrajectoryPoint(positions=[0.234] * 6)] * count
    goal = ExecuteStruts.Goal(trajectory=JointTrajectory(joint_names=STRUT_NAMES, points=points))
    print("flooding", flush=True)
    sent = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, sent)
    ended = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    print(ended.result().result.reason, flush=True)


def main(words: list[str]) -> None:
    """Flood a topic; says "flooding" once it is heard."""
    if words[0] == "execute_struts":
        rclpy.init()
        send_points(int(words[1]))
        return
    topic, type_name, size = words[0], words[1], int(words[2]) if len(words) > 2 else 0
    rclpy.init()
    node = Node("flood")
    kind = message_class(type_name)
    publisher = node.create_publisher(kind, topic, QoSProfile(depth=100))
    data = flooding(kind, size)
    end = time.monotonic() + LATE_S
    while not publisher.get_subscription_count():
        if time.monotonic() > end:
            sys.exit(f"nobody listens to {topic}")
        time.sleep(0.01)
    print("flooding", flush=True)
    while True:
        publisher.publish(data)


if __name__ == "__main__":
    main(sys.argv[1:])
