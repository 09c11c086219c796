# SPDX-License-Identifier: Apache-2.0
"""A node's topics and the session's bag together: what is published is recorded, from the same bytes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher

from hardware_bridge.recording.bag_quota import Quota
from hardware_bridge.recording.session_bag import SessionLog
from tensegrity_robot.ros.cdr import wire_bytes
from tensegrity_robot.ros.topics import Topic


class Recorded(NamedTuple):
    """A publisher whose messages are recorded."""

    publisher: Publisher
    topic: str
    type_name: str


class RecordedTopics:
    """Publishers and subscriptions of one node that also write to its bag.

    Attributes:
        log: the bag, while there is one.
        types: topic -> (type, transient_local), for the bag.
    """

    def __init__(self, node: LifecycleNode):
        self._node = node
        self.log: SessionLog | None = None
        self.types: dict[str, tuple[str, bool]] = {}
        self._quotas: dict[str, Quota] = {}

    @property
    def dropped(self) -> dict[str, int]:
        """Messages of other nodes that were over their topic's quota, by topic."""
        return {name: quota.dropped for name, quota in self._quotas.items() if quota.dropped}

    def publisher(self, topic: Topic) -> Recorded:
        """A publisher for `publish`."""
        publisher = topic.publisher(self._node)
        self.types[publisher.topic_name] = (topic.type_name, topic.latched)
        return Recorded(publisher, publisher.topic_name, topic.type_name)

    def record(self, topic: Topic, wanted: Callable[[bytes], bool] = lambda data: True) -> None:
        """Record what another node publishes, as far as its quota goes, if it is wanted."""
        name = self._node.resolve_topic_name(topic.name)
        self.types[name] = (topic.type_name, topic.latched)
        quota = self._quotas[name] = Quota()

        def record(data: bytes) -> None:
            if self.log is None:
                return
            if not quota.takes(len(data), time.monotonic()):
                if quota.dropped == 1:
                    self._node.get_logger().warning(f"{name}: more, or longer, than the bag takes; the rest is not recorded")
            elif wanted(data):  # it may be slow: not for nothing
                self._write(name, topic.type_name, data)

        topic.subscribe(self._node, record, raw=True)

    def publish(self, to: Recorded, message: Any) -> None:
        """Serialise once, record, publish. From any thread."""
        data = wire_bytes(message)
        self._write(to.topic, to.type_name, data)
        to.publisher.publish(data)

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        log = self.log  # it may end meanwhile, in another thread
        if log is not None:
            log.write(topic, type_name, data, time.time_ns())  # the system's clock, never a simulated one
