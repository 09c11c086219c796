# SPDX-License-Identifier: Apache-2.0
"""Somebody beside the stack: hears what it publishes, commands the bridge; every wait has a limit."""

from __future__ import annotations

import os
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hardware_bridge.errors import may_be_sent_again
from hardware_bridge.safety.lease_proof import Prover
from tensegrity_interfaces.action import ExecuteStruts
from tensegrity_interfaces.msg import BridgeState, LeaseProof, StrutsSent, TwinState
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import Stack, wait_until

ANSWER_LIMIT_S = 15.0
START_LIMIT_S = 60.0
MOST_SENDS = 5
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEEP = QoSProfile(depth=2000)


class Probe:
    """A ROS client in a context of its own.

    Attributes:
        ticks: (stamp in ns, when heard on the steady clock in ns) of every twin/joint_states.
        states: when each twin/state was heard, on the steady clock in ns.
        writes: (stamp in ns, heartbeat) of every bridge/struts_sent.
        log: (when heard in s, messages, most waiting) of the bag, newest diagnostics; None before.
        twin, bridge: newest states.
        prototype: instance of the virtual prototype that may be armed; empty: any.
    """

    def __init__(self, stack: Stack):
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")  # as the nodes do
        self._stack = stack
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = Node("sixstrut_bench", context=self._context)
        self.ticks: list[tuple[int, int]] = []
        self.states: list[int] = []
        self.writes: list[tuple[int, bool]] = []
        self.log: tuple[float, int, int] | None = None
        self.twin: Any = None
        self.bridge: Any = None
        self._lease = ""
        self._prover = Prover("")
        self.prototype = ""
        node.create_subscription(JointState, "twin/joint_states", self._on_tick, DEEP, raw=True)
        node.create_subscription(TwinState, "twin/state", self._on_twin, DEEP)
        node.create_subscription(StrutsSent, "bridge/struts_sent", self._on_sent, DEEP)
        node.create_subscription(BridgeState, "bridge/state", lambda message: setattr(self, "bridge", message), LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._proof = node.create_publisher(LeaseProof, "bridge/lease", 10)
        node.create_timer(0.2, self._prove)
        self._arm = node.create_client(Arm, "bridge/arm")
        self._stop = node.create_client(Trigger, "stop")
        self._reset = node.create_client(Trigger, "reset")
        self._struts = ActionClient(node, ExecuteStruts, "execute_struts")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name="probe", daemon=True)
        self._thread.start()

    def __enter__(self) -> Probe:
        return self

    def __exit__(self, *details: object) -> None:
        self._executor.shutdown()
        self._thread.join(5.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    # ---- hearing ----------------------------------------------------------------------------------------------------

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _on_tick(self, data: bytes) -> None:
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)  # the header's stamp, behind the encapsulation
        self.ticks.append((seconds * 1_000_000_000 + nanoseconds, time.monotonic_ns()))

    def _on_twin(self, message: TwinState) -> None:
        self.states.append(time.monotonic_ns())
        self.twin = message

    def _on_sent(self, message: StrutsSent) -> None:
        stamp = message.header.stamp
        self.writes.append((stamp.sec * 1_000_000_000 + stamp.nanosec, message.heartbeat))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if "most waiting" in values:
                self.log = (time.monotonic(), int(values["messages"]), int(values["most waiting"]))

    def _prove(self) -> None:
        if self._lease:
            counter, proof = self._prover.next()
            self._proof.publish(LeaseProof(stamp=self._node.get_clock().now().to_msg(), counter=counter, proof=list(proof)))

    def wait(self, condition: Callable[[], object], what: str, limit_s: float = ANSWER_LIMIT_S) -> None:
        """Wait for a condition. Raises StackError naming `what`."""
        wait_until(condition, limit_s, what, self._stack)

    def meet_stack(self) -> None:
        """Until the bridge's port is open and the twin follows its events."""
        self.wait(lambda: self.bridge is not None and self.bridge.link_ok, "the bridge's link", START_LIMIT_S)
        self.wait(lambda: self.bridge.bag, "the bridge's bag", START_LIMIT_S)
        self.wait(lambda: self.twin is not None and self.twin.last_seq > 0, "a twin that follows", START_LIMIT_S)
        self.wait(lambda: self.ticks, "the twin's joint states", START_LIMIT_S)
        self.wait(self._struts.server_is_ready, "the bridge's action execute_struts", START_LIMIT_S)

    # ---- commanding -------------------------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """ROS time, which stamps are of."""
        return int(self._node.get_clock().now().nanoseconds)

    def arm(self, lengths_m: list[float]) -> None:
        """Take the bridge's lease and wait for the end of homing. Raises StackError."""
        request = Arm.Request(holder="bench", lifted_and_clear=True, prototype=self.prototype)
        request.confirmed_lengths_m = lengths_m
        self.wait(self._arm.service_is_ready, "the bridge's service arm", START_LIMIT_S)
        answer = self._result(self._arm.call_async(request), "an answer to arm")
        if not answer.success:
            raise StackError(f"arming was refused: {answer.message}")
        self._prover, self._lease = Prover(answer.lease), answer.lease
        self.wait(lambda: self.bridge.state == BridgeState.ARMED, "the end of homing", START_LIMIT_S)

    def move(self, lengths_m: list[float], seconds: float) -> tuple[Any, int]:
        """Begin a motion of the struts; its goal handle, and the ROS time of the call in ns. Raises StackError."""
        point = JointTrajectoryPoint(positions=lengths_m)
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(round(seconds * 1e9), 1_000_000_000)
        trajectory = JointTrajectory(joint_names=[f"S{number}" for number in range(1, 7)], points=[point])
        goal = ExecuteStruts.Goal(trajectory=trajectory, lease=self._lease)

        began: list[int] = []
        running: list[Any] = []

        def send() -> Any:
            stamp = self._node.get_clock().now()
            trajectory.header.stamp = stamp.to_msg()
            began.append(int(stamp.nanoseconds))
            return self._struts.send_goal_async(goal, feedback_callback=running.append)

        for _ in range(MOST_SENDS):  # again, if judging it took longer than its stamp is good for
            began.clear()
            running.clear()
            handle = self._called(send, "an answer to execute_struts")
            if not handle.accepted:
                raise StackError("the bridge rejected a motion")
            ended = self._begun(handle.get_result_async)
            self.wait(partial(_either, running, ended), "a verdict on a motion", START_LIMIT_S)
            if running or not may_be_sent_again(ended.result().result.reason):
                break
        return handle, began[0]

    def end(self, handle: Any) -> Any:
        """The result of a motion, with its status."""
        return self._called(handle.get_result_async, "the end of a motion")

    def cancel(self, handle: Any) -> int:
        """Cancel a motion and wait for its end; the ROS time of the call in ns."""
        began: list[int] = []

        def send() -> Any:
            began.append(self.now_ns())
            return handle.cancel_goal_async()

        self._called(send, "an answer to cancel")
        self.end(handle)
        return began[0]

    def stop(self) -> int:
        """Stop; the ROS time of the call in ns."""
        began: list[int] = []

        def send() -> Any:
            began.append(self.now_ns())
            return self._stop.call_async(Trigger.Request())

        self._called(send, "an answer to stop")
        self._lease = ""
        return began[0]

    def reset(self) -> None:
        """Out of the fault that a stop is."""
        answer = self._called(lambda: self._reset.call_async(Trigger.Request()), "an answer to reset")
        if not answer.success:
            raise StackError(f"reset was refused: {answer.message}")
        self.wait(lambda: self.bridge.state == BridgeState.DISARMED, "DISARMED after reset")

    def _called(self, call: Callable[[], Any], what: str) -> Any:
        """Call in the executor's thread: from another, the answer can arrive before it is waited for."""

        return self._result(self._begun(call), what)

    def _begun(self, call: Callable[[], Any]) -> Any:
        """The future of what a call answers at last."""

        async def ask() -> Any:
            return await call()

        return self._executor.create_task(ask)

    def _result(self, future: Any, what: str) -> Any:
        self.wait(future.done, what)
        return future.result()


def _either(feedback: list[Any], ended: Any) -> bool:
    """A motion is under way, or over."""
    return bool(feedback) or bool(ended.done())
