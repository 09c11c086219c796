# SPDX-License-Identifier: Apache-2.0
"""An observer of the robot, behind a Unix socket, as the bridge's node uses it: faces into the stream, joints for viewers."""

import time
from functools import partial

import numpy as np
from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import Header

from hardware_bridge.driver.events import SentEvent, Snapshot
from hardware_bridge.driver.remote_bridge import RemoteBridge
from hardware_bridge.errors import BridgeError, StateError
from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from sim_core.structure.topology import STRUTS
from tensegrity_interfaces.msg import FaceObservation
from tensegrity_robot.bridge import bridge_messages
from tensegrity_robot.bridge.recorded_topics import RecordedTopics
from tensegrity_robot.bridge.strut_rest import StillWatch
from tensegrity_robot.ros.event_filters import ObservationFilter
from tensegrity_robot.ros.topics import OBSERVED_JOINTS

NOBODY = "none"
"""In the place of an observer's socket."""
OBSERVED_PERIOD_S = 0.04
"""Wall time between published observations of joints; a fast virtual prototype makes more of them."""


class Observing:
    """Follows one observer at a time. Its callbacks come in the observer's own thread."""

    def __init__(self, node: LifecycleNode, topics: RecordedTopics, frame: str, stall_limit_m: float):
        """Args: frame: of observed joints. stall_limit_m: see `stalled`."""
        self._node = node
        self._topics = topics
        self._frame = frame
        self._news = ObservationFilter()
        self._client: ObserverClient | None = None
        self._bridge: RemoteBridge | None = None
        self._source = FaceObservation.SOURCE_EXTERNAL
        self._lengths_m: tuple[float, ...] | None = None
        self._stall_limit_m = stall_limit_m
        self._still = StillWatch()
        self._published_s = 0.0
        self.there: bool | None = None  # None: none is expected

    def begin(self, bridge: RemoteBridge, given: str) -> None:
        """Follow the observer that was given, else the virtual prototype's own, if there is one, unless nobody is to look."""
        self._news, self._lengths_m, self._bridge = ObservationFilter(), None, bridge
        self._still = StillWatch()
        self._source = FaceObservation.SOURCE_EXTERNAL if given else FaceObservation.SOURCE_PROTOTYPE
        path = given or bridge.observer
        if path and given != NOBODY:
            self.there = False
            self._client = ObserverClient(path, self._on_observation, partial(setattr, self, "there"))

    def end(self) -> None:
        """Leave the observer."""
        client, self._client, self._bridge, self.there = self._client, None, None, None
        if client is not None:
            client.close()

    def heard(self, event: SentEvent) -> None:
        """The bridge sent something, or nothing; after a frame the next face is news."""
        self._still.hear(event.robot_time_ns, not event.heartbeat)
        if not event.heartbeat:
            self._news.moved()

    def unknown_lengths_m(self, snapshot: Snapshot) -> list[float | None] | None:
        """For struts whose length nobody knows: as the observer sees them, if there is one."""
        seen = self._lengths_m
        if all(snapshot.known) or seen is None or not self.there:
            return None
        return [None if known else length for known, length in zip(snapshot.known, seen, strict=True)]

    def stalled(self, snapshot: Snapshot) -> str:
        """Which strut is seen at rest elsewhere than it was sent; empty: none, or nobody sees it. No board tells a stall."""
        seen = self._lengths_m
        if seen is None or not self.there or snapshot.moving or not all(snapshot.known) or not self._still.is_still:
            return ""
        away_m = [length - sent for length, sent in zip(seen, snapshot.lengths_m, strict=True)]
        worst = max(range(len(away_m)), key=lambda index: abs(away_m[index]))
        if abs(away_m[worst]) <= self._stall_limit_m:
            return ""
        return (
            f"S{worst + 1} stands {away_m[worst] * 1e3:+.1f} mm from where it was sent ({self._source} sees it), the limit is "
            f"{self._stall_limit_m * 1e3:g} mm: it has stalled or is jammed; free it, or go back to mid stroke"
        )

    def _on_observation(self, observation: Observation) -> None:
        bridge = self._bridge
        if bridge is None:
            return
        ends = np.array(STRUTS)
        ways_m = observation.joints_m[ends[:, 1]] - observation.joints_m[ends[:, 0]]
        self._lengths_m = tuple(float(length) for length in np.linalg.norm(ways_m, axis=1))
        self._still.see(observation.robot_time_ns, self._lengths_m)
        settled = observation.settled and self._still.is_after_last_frame
        if self._news.is_news(observation.face, settled):
            try:
                bridge.observe_face(observation.face or "", self._source, settled, observation.detail)
            except StateError:
                return  # closed in the meantime
            except BridgeError as error:
                self._node.get_logger().warning(f"observation not used: {error}", throttle_duration_sec=5.0)
        if time.monotonic() - self._published_s >= OBSERVED_PERIOD_S:
            self._published_s = time.monotonic()
            header = Header(stamp=self._node.get_clock().now().to_msg(), frame_id=self._frame)
            self._topics.publish(OBSERVED_JOINTS, bridge_messages.observed_joints(observation, header))
