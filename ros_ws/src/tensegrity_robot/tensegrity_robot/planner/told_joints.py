# SPDX-License-Identifier: Apache-2.0
"""Where the robot's joints are, as somebody sees them, or as the twin predicts them."""

import time
from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseArray
from rclpy.node import Node

from sim_core.structure.arrays import Array
from sim_core.twin.live_bridge import is_fresh
from tensegrity_robot.ros import topics


class ToldJoints:
    """What a node hears of them."""

    def __init__(self, node: Node):
        self._node = node
        self._told: dict[str, tuple[float, Array]] = {}
        for topic in (topics.TWIN_JOINTS, topics.OBSERVED_JOINTS):
            topic.subscribe(node, self._keep(topic.name))

    def newest(self, watched: bool, since: float = 0.0) -> Array | None:
        """The twelve joints, (12, 3): if `watched` as seen, else predicted; told after `since` (time.monotonic)."""
        seen = self._told.get(topics.OBSERVED_JOINTS.name) if watched else None
        told = seen or self._told.get(topics.TWIN_JOINTS.name)
        return told[1] if told is not None and told[0] >= since else None

    def _keep(self, name: str) -> Callable[[PoseArray], None]:
        def keep(message: PoseArray) -> None:
            if not is_fresh(message.header.stamp, self._node.get_clock().now().nanoseconds):
                return  # of a recording
            places = np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:12]])
            self._told[name] = time.monotonic(), places

        return keep
