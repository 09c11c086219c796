# SPDX-License-Identifier: Apache-2.0
"""Long work in a background thread, awaited in an executor that goes on meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future


def elsewhere(node: Node, work: Callable[[], None], name: str) -> Future:
    """Runs `work` in a thread of its own; await the answer, or its exception, in a callback of the node."""
    done: Future = Future()

    def finish(error: Exception | None) -> None:
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    def body() -> None:
        error: Exception | None = None
        try:
            work()
        except Exception as failure:
            error = failure
        if node.executor is not None:
            node.executor.create_task(finish, error)

    threading.Thread(target=body, name=name, daemon=True).start()
    return done
