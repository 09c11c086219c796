"""Somebody who publishes one message as fast as the computer can, until the process is ended.

    python -m sixstrut_cli.faults.flood bridge/lease tensegrity_interfaces/msg/LeaseProof

The size of a text or list field can be given, to make each message large: `twin/markers visualization_msgs/msg/MarkerArray 100000`.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from sixstrut_cli.ros_types import message_class

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


def main(words: list[str]) -> None:
    """Flood a topic; says "flooding" once it is heard."""
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
