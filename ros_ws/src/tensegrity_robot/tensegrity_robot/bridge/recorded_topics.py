# SPDX-License-Identifier: Apache-2.0
"""A node's topics and the session's bag together: what is published is recorded, from the same bytes."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher

from hardware_bridge.recording.bag_quota import Quota
from hardware_bridge.recording.session_bag import SessionLog
from tensegrity_robot.ros.cdr import wire_bytes
from tensegrity_robot.ros.topics import TOPICS, Topic


class RecordedTopics:
    """The bridge publishes, and hears others, on the topics of the table; all that goes into its bag.

    Attributes:
        log: the bag, while there is one.
        types: topic -> (type, transient_local), for the bag.
        dropped: messages of other nodes that were over their topic's quota.
    """

    def __init__(self, node: LifecycleNode, wanted: Mapping[str, Callable[[bytes], bool]]):
        """Args: wanted: of other nodes' topics, by name: whether a message goes into the bag; all do where none is given."""
        self._node = node
        self.log: SessionLog | None = None
        self.types: dict[str, tuple[str, bool]] = {}
        self.dropped = 0
        self._names = {topic.name: node.resolve_topic_name(topic.name) for topic in TOPICS}
        self._publishers: dict[str, Publisher] = {}
        for topic in TOPICS:
            if topic.told_by == "bridge":
                self._publishers[topic.name] = topic.publisher(node)
            elif topic.told_by == "others":
                self._record(topic, wanted.get(topic.name, lambda data: True))
            if topic.told_by:
                self.types[self._names[topic.name]] = (topic.type_name, topic.latched)

    def _record(self, topic: Topic, wanted: Callable[[bytes], bool]) -> None:
        """Record what another node publishes, as far as its quota goes, if it is wanted."""
        quota = Quota()

        def record(data: bytes) -> None:
            if self.log is None:
                return
            if not quota.takes(len(data), time.monotonic()):
                self.dropped += 1
                if quota.dropped == 1:
                    name = self._names[topic.name]
                    self._node.get_logger().warning(f"{name}: more, or longer, than the bag takes; the rest is not recorded")
            elif wanted(data):  # it may be slow: not for nothing
                self._write(topic, data)

        topic.subscribe(self._node, record, raw=True)

    def publish(self, topic: Topic, message: Any) -> None:
        """Serialise once, record, publish. From any thread."""
        data = wire_bytes(message)
        self._write(topic, data)
        self._publishers[topic.name].publish(data)

    def _write(self, topic: Topic, data: bytes) -> None:
        log = self.log  # it may end meanwhile, in another thread
        if log is not None:
            log.write(self._names[topic.name], topic.type_name, data, time.time_ns())  # the system's clock, never a simulated one
