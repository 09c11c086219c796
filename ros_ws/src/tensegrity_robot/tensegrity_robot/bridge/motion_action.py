# SPDX-License-Identifier: Apache-2.0
"""The action `execute_struts`: goals in, feedback and results out. What may move is the bridge's decision alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from hardware_bridge.driver.motion_handle import MotionHandle
from hardware_bridge.driver.remote_bridge import RemoteBridge
from hardware_bridge.errors import BridgeError, Refused
from hardware_bridge.safety.command_age import Age
from tensegrity_interfaces.action import ExecuteStruts
from tensegrity_robot.bridge import bridge_messages
from tensegrity_robot.bridge.recorded_topics import RecordedTopics
from tensegrity_robot.ros import conversions
from tensegrity_robot.ros.background import elsewhere
from tensegrity_robot.ros.bounded_goals import TooLong, bound_goals
from tensegrity_robot.ros.topics import ASKED

if TYPE_CHECKING:
    from tensegrity_robot.bridge.hardware_bridge_node import HardwareBridgeNode


class MotionServer:
    """Serves `execute_struts` of the bridge's node. All but its making happens in the executor's thread."""

    def __init__(self, node: HardwareBridgeNode, topics: RecordedTopics):
        self._node = node
        self._topics = topics
        bound_goals()
        self._motions: list[tuple[ServerGoalHandle, RemoteBridge, MotionHandle, Future]] = []
        self._server = ActionServer(node, ExecuteStruts, "execute_struts", self._execute, cancel_callback=self._on_cancel)

    def destroy(self) -> None:
        """Ends the action."""
        self._server.destroy()

    def attend(self) -> None:
        """Feedback, and the ends of motions."""
        for row in list(self._motions):
            goal, bridge, motion, done = row
            if motion.result() is not None:
                self._motions.remove(row)
                done.set_result(None)
            elif goal.is_active:
                progress, mode = motion.progress(), str(bridge.snapshot().mode)
                goal.publish_feedback(ExecuteStruts.Feedback(state=mode, progress=progress.fraction, length_m=progress.lengths_m))

    def finish(self) -> None:
        """The bridge is closed: whoever waits is told."""
        for *_, done in self._motions:
            done.set_result(None)
        self._motions.clear()

    async def _execute(self, goal: ServerGoalHandle) -> ExecuteStruts.Result:
        request = goal.request
        lengths_m: tuple[float, ...] = (float("nan"),) * 6
        try:
            bridge = self._node.ready()
            if isinstance(request, TooLong):
                raise Refused(request.why)
            snapshot = bridge.snapshot()
            lengths_m = snapshot.lengths_m
            if request.session and request.session != snapshot.session:
                raise Refused(f"the goal is for session {request.session}, this bridge's is {snapshot.session}: arm again")
            now_ns = self._node.get_clock().now().nanoseconds
            age = Age((now_ns - conversions.nanoseconds(request.trajectory.header.stamp)) * 1e-9)
            trajectory = bridge_messages.trajectory_of(request.trajectory)
            self._node.permit(trajectory, request.library_hash)
            if request.overtake:
                motion = await elsewhere(
                    self._node, lambda: bridge.execute(trajectory, request.lease, age.now_s(), True), "judge a motion"
                )
            else:
                await elsewhere(self._node, lambda: bridge.judge_motion(trajectory, request.lease), "judge a motion")
                if self._node.ready() is not bridge:
                    raise Refused("the bridge was opened anew while the motion was judged; arm again")
                self._node.permit(trajectory, request.library_hash)  # judging may have taken seconds
                motion = bridge.execute(trajectory, request.lease, age.now_s())
        except BridgeError as error:
            self._node.get_logger().warning(f"motion refused: {error}")
            goal.abort()
            return ExecuteStruts.Result(reason=str(error), length_m=lengths_m)
        self._topics.publish(ASKED, request.trajectory)
        if goal.is_cancel_requested:
            motion.cancel("cancelled by its commander")
        done: Future = Future()
        self._motions.append((goal, bridge, motion, done))
        await done
        result = motion.result()
        if result is not None and result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        if result is None:
            return ExecuteStruts.Result(reason="the bridge was closed", length_m=lengths_m)
        return ExecuteStruts.Result(success=result.success, reason=result.reason, length_m=result.lengths_m)

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        for running, _, motion, _ in self._motions:
            if running is goal:
                motion.cancel("cancelled by its commander")
        return CancelResponse.ACCEPT
