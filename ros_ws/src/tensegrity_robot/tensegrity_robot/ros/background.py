# SPDX-License-Identifier: Apache-2.0
"""Long work in a background thread, awaited in an executor that goes on meanwhile."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.task import Future


def elsewhere(node: Node, work: Callable[[], Any], name: str) -> Future:
    """Runs `work` in a thread of its own; await what it returns or raises in a callback of the node."""
    done: Future = Future()

    def body() -> None:
        try:
            finish = partial(done.set_result, work())
        except Exception as error:
            finish = partial(done.set_exception, error)
        if node.executor is not None:
            node.executor.create_task(finish)

    threading.Thread(target=body, name=name, daemon=True).start()
    return done
