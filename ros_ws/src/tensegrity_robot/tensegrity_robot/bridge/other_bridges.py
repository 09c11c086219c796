# SPDX-License-Identifier: Apache-2.0
"""Whether another bridge answers to this one's name: two would both obey one call.

A bridge tells its state at 2 Hz. Who is heard there with another session, just now, is another bridge. A service would be no sign:
it seems to be there for seconds after its process was killed.
"""

import time

from rclpy.lifecycle import LifecycleNode

from sim_core.twin.live_bridge import is_fresh
from tensegrity_interfaces.msg import BridgeState
from tensegrity_robot.ros import qos
from tensegrity_robot.ros.topics import BRIDGE_STATE

HEARD_S = 1.5
"""A bridge that has not been heard for so long is none: three of its periods."""

LISTEN_S = 0.8
"""Whoever is there is met, and heard, within this time after the node was made, on a computer that has time for it."""

LATE_S = 10.0
"""Whoever was not met in time is met within this time."""


class OtherBridges:
    """Listens to `bridge/state` of a node's own name."""

    def __init__(self, node: LifecycleNode):
        self._node = node
        self._made_s = time.monotonic()
        self._own: set[str] = set()
        self._heard: dict[str, tuple[float, str]] = {}
        self._states = BRIDGE_STATE.subscribe(node, self._hear, qos.FACES)

    def own(self, session: str) -> None:
        """A session of this bridge; what it told before is its own, too."""
        self._own.add(session)

    def found(self) -> str:
        """Where another bridge is, and what to do; empty: there is none."""
        now = time.monotonic()
        for session, (heard_s, port) in self._heard.items():
            if session not in self._own and now - heard_s < HEARD_S:
                name = self._node.resolve_topic_name(BRIDGE_STATE.name)
                return (
                    f"another bridge, with port {port}, answers to the same names ({name}): end it, or start this one in a "
                    "namespace or ROS domain of its own"
                )
        return ""

    @property
    def may_be_late(self) -> bool:
        """Another one may have been there before, and is only heard now."""
        return time.monotonic() - self._made_s < LATE_S

    def listen(self) -> str:
        """As `found`, once every bridge that is there must have been heard. In the executor's thread, or before there is one."""
        while True:
            with self._states.handle:
                taken = self._states.handle.take_message(BridgeState, False)
            if taken is not None:
                self._hear(taken[0])
            elif time.monotonic() - self._made_s > LISTEN_S:
                return self.found()
            else:
                time.sleep(0.01)

    def _hear(self, state: BridgeState) -> None:
        if state.session and is_fresh(state.header.stamp, self._node.get_clock().now().nanoseconds):
            self._heard[state.session] = (time.monotonic(), state.port)
            while len(self._heard) > 20:
                del self._heard[next(iter(self._heard))]
