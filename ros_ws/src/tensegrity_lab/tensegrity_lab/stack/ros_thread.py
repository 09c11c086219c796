# SPDX-License-Identifier: Apache-2.0
"""A ROS node in a thread of its own, for programs whose main thread belongs to something else."""

import threading
import traceback

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node


class Spinner:
    """A node in a thread of its own that goes on whatever a callback raises: nothing that is heard may end a stop button."""

    def __init__(self, node: Node, context: Context):
        self.node = node
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(node)
        self._closing = False
        self._thread = threading.Thread(target=self._spin, name=node.get_name(), daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while True:
            try:
                self.executor.spin()
                return
            except ExternalShutdownException:
                return
            except Exception:
                if self._closing:  # what the executor still held was destroyed under it
                    return
                traceback.print_exc()

    def close(self) -> None:
        """End the thread and the node."""
        self._closing = True
        self.executor.shutdown()
        self._thread.join(5.0)
        self.node.destroy_node()
