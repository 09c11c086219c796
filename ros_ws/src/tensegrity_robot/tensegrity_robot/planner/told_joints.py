# SPDX-License-Identifier: Apache-2.0
"""Where the robot's joints are, as somebody sees them, or as the twin predicts them."""

import time

import numpy as np
from geometry_msgs.msg import PoseArray
from rclpy.node import Node

from sim_core.structure.arrays import Array
from sim_core.twin.live_bridge import is_fresh


class ToldJoints:
    """What a node hears of them: `see` is told observed joints, `predict` the twin's."""

    def __init__(self, node: Node):
        self._node = node
        self._seen: tuple[float, Array] | None = None
        self._predicted: tuple[float, Array] | None = None

    def newest(self, watched: bool, since: float = 0.0) -> Array | None:
        """The twelve joints, (12, 3): if `watched` as seen, else predicted; told after `since` (time.monotonic)."""
        told = (self._seen if watched else None) or self._predicted
        return told[1] if told is not None and told[0] >= since else None

    def see(self, message: PoseArray) -> None:
        """Somebody saw them."""
        self._seen = self._fresh(message) or self._seen

    def predict(self, message: PoseArray) -> None:
        """The twin predicts them."""
        self._predicted = self._fresh(message) or self._predicted

    def _fresh(self, message: PoseArray) -> tuple[float, Array] | None:
        if not is_fresh(message.header.stamp, self._node.get_clock().now().nanoseconds):
            return None  # of a recording
        return time.monotonic(), np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:12]])
