# SPDX-License-Identifier: Apache-2.0
"""Where the robot's joints are, as somebody sees them, or as the twin predicts them, turned as an inertial sensor feels it."""

import math
import time

import numpy as np
from geometry_msgs.msg import PoseArray
from rclpy.node import Node

from sim_core.structure.arrays import Array
from sim_core.structure.rotations import about_z
from sim_core.twin.live_bridge import FRESH_S, is_fresh
from tensegrity_interfaces.msg import FaceEstimate


class ToldJoints:
    """What a node hears of them: `see` is told observed joints, `predict` the twin's, `feel` how far the twin's heading is off."""

    def __init__(self, node: Node):
        self._node = node
        self._ahead_rad = self._used_rad = 0.0
        self._shift_m = np.zeros(3)
        self._seen: tuple[float, Array] | None = None
        self._predicted: tuple[float, Array] | None = None

    def newest(self, watched: bool, since: float = 0.0) -> Array | None:
        """The twelve joints, (12, 3): if `watched` as seen, else predicted; told after `since` (time.monotonic), and lately."""
        lately = time.monotonic() - FRESH_S
        told = (self._seen if watched and self._seen is not None and self._seen[0] > lately else None) or self._predicted
        return told[1] if told is not None and told[0] > lately and told[0] >= since else None

    def see(self, message: PoseArray) -> None:
        """Somebody saw them."""
        self._seen = self._fresh(message) or self._seen

    def predict(self, message: PoseArray) -> None:
        """The twin predicts them. What it rolled since its heading was corrected last leads into the corrected heading."""
        told = self._fresh(message)
        if told is None:
            return
        heard_s, joints = told
        if self._ahead_rad != self._used_rad:
            center = joints.mean(axis=0)
            self._shift_m += (about_z(self._used_rad) - about_z(self._ahead_rad)) @ center
            self._used_rad = self._ahead_rad
        self._predicted = heard_s, joints @ about_z(self._used_rad).T + self._shift_m

    def feel(self, message: FaceEstimate) -> None:
        """An inertial sensor tells how far the twin's heading is off."""
        if math.isfinite(message.ahead_rad) and is_fresh(message.header.stamp, self._node.get_clock().now().nanoseconds):
            self._ahead_rad = float(message.ahead_rad)

    def _fresh(self, message: PoseArray) -> tuple[float, Array] | None:
        if not is_fresh(message.header.stamp, self._node.get_clock().now().nanoseconds):
            return None  # of a recording
        return time.monotonic(), np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:12]])
