# SPDX-License-Identifier: Apache-2.0
"""Lines of a session's ledger into the bag, each on the disk before it is acknowledged."""

from __future__ import annotations

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNode

from hardware_bridge.errors import BridgeError
from tensegrity_interfaces.srv import LogTrial
from tensegrity_robot.bridge.recorded_topics import RecordedTopics
from tensegrity_robot.ros.background import elsewhere
from tensegrity_robot.ros.topics import TRIAL


def serve_trial_log(node: LifecycleNode, topics: RecordedTopics) -> None:
    """Serve `log_trial` on a node: publish and record the line on `bridge/trial`, then wait for the disk."""
    trials = topics.publisher(TRIAL)

    async def log_trial(request: LogTrial.Request, response: LogTrial.Response) -> LogTrial.Response:
        log = topics.log
        if log is None or log.path is None:
            response.message = "the bridge does not record: start it with record:=true"
            return response
        topics.publish(trials, request.record)
        try:
            await elsewhere(node, log.sync, "sync the bag")
        except BridgeError as error:
            response.message = str(error)
            return response
        response.success, response.message = True, f"in {log.path}"
        return response

    # It waits for the disk; in the node's own group everything else would wait with it.
    node.create_service(LogTrial, "log_trial", log_trial, callback_group=ReentrantCallbackGroup())
