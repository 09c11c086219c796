"""An operator of the running stack, as a ROS client: arms, rolls, watches."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from hardware_bridge.text import printable
from sixstrut_cli.errors import StackError
from sixstrut_cli.stack import Stack, wait_until
from tensegrity_interfaces.action import Roll, Travel
from tensegrity_interfaces.msg import BridgeState, FaceObservation, TrialRecord, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, LogTrial, SetFace
from tensegrity_robot.discovery import discovery_changes, loopback_profile
from tensegrity_robot.live_bridge import LiveBridge

LONGEST_WORDS = 2000
DISCOVERY_LIMIT_S = 30.0
ARM_LIMIT_S = 40.0
"""The planner gives the bridge so long to load its judge of shapes, and a little more."""
STOP_AGAIN_S = 0.5
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Operator:
    """Talks to the stack; every wait has a limit.

    Args:
        prototype: instance of the virtual prototype that is meant: nothing is heard or wanted of another one's bridge. Empty:
            whatever robot the stack has.

    Attributes:
        bridge, twin, observed: newest bridge state, twin state, face observation; None before the first.
        bridge_before: the bridge state before that.
        heard: when (time.monotonic) the bridge was heard last.
    """

    def __init__(self, stack: Stack, prototype: str = ""):
        self._stack = stack
        self._prototype = prototype
        os.environ.update(discovery_changes(os.environ, loopback_profile()))
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("sixstrut_operator")
        self.bridge: Any = None
        self.twin: Any = None
        self.observed: Any = None
        self.bridge_before: Any = None
        self.heard = 0.0
        self._twin_joints: np.ndarray | None = None
        self._seen_joints: np.ndarray | None = None
        subscribe = self._node.create_subscription
        self._live = live = LiveBridge(self._node.get_logger().warning)
        keep = self._keep("observed")
        subscribe(BridgeState, "bridge/state", self._keep_bridge, LATCHED)
        subscribe(FaceObservation, "bridge/face", lambda face: live.takes(face, keep), LATCHED)
        subscribe(TwinState, "twin/state", self._keep("twin"), 10)
        subscribe(PoseArray, "twin/joints", self._keep_joints("_twin_joints"), 10)
        subscribe(PoseArray, "bridge/observed_joints", self._keep_joints("_seen_joints"), 10)
        self._arm = self._node.create_client(Arm, "arm")
        self._disarm = self._node.create_client(Disarm, "disarm")
        self._set_face = self._node.create_client(SetFace, "set_face")
        self._log_trial = self._node.create_client(LogTrial, "log_trial")
        self._triggers = {name: self._node.create_client(Trigger, name) for name in ("stop", "reset")}
        self._roll = ActionClient(self._node, Roll, "roll")
        self._travel = ActionClient(self._node, Travel, "travel")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _keep(self, name: str) -> Callable[[Any], None]:
        return lambda message: setattr(self, name, message)

    def _keep_bridge(self, message: Any) -> None:
        if self._prototype and message.prototype != self._prototype:
            return  # another robot's, or not proven yet
        if not self._live.hears(message, self._node.get_clock().now().nanoseconds):
            return  # a recording's
        self.bridge_before, self.bridge, self.heard = self.bridge, _shown(message), time.monotonic()

    def _keep_joints(self, name: str) -> Callable[[PoseArray], None]:
        def keep(message: PoseArray) -> None:
            setattr(self, name, np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:12]]))

        return keep

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self._thread.join(5.0)
        self._node.destroy_node()
        rclpy.try_shutdown()

    def wait_for_stack(self, observer: bool = True) -> None:
        """Until planner, bridge and twin are there and the port is open; and, with an observer, a face was seen."""
        wait_until(lambda: self.bridge is not None and self.bridge.link_ok, DISCOVERY_LIMIT_S, "the bridge's link", self._stack)
        wait_until(lambda: self.twin is not None and self.twin.face, DISCOVERY_LIMIT_S, "the twin's first state", self._stack)
        wait_until(self._arm.service_is_ready, DISCOVERY_LIMIT_S, "the planner's service arm", self._stack)
        wait_until(self._roll.server_is_ready, DISCOVERY_LIMIT_S, "the planner's action roll", self._stack)
        if observer:
            wait_until(lambda: self.observed is not None, DISCOVERY_LIMIT_S, "the first observed face", self._stack)

    def _require_alone(self) -> None:
        """Raise StackError if another bridge has come: with a virtual prototype, nothing is asked of two."""
        if self._prototype and self._node.count_publishers("bridge/state") > 1:
            raise StackError("another hardware bridge has come into this ROS domain: end it, then try again")

    def arm(self, confirmed_lengths_m: Sequence[float]) -> None:
        """Arm and wait for the end of homing. StackError with the bridge's reason if refused."""
        self._require_alone()
        request = Arm.Request(holder="operator", lifted_and_clear=True, prototype=self._prototype)
        request.confirmed_lengths_m = list(confirmed_lengths_m)
        answer = self._result(self._arm.call_async(request), ARM_LIMIT_S, "an answer to arm")
        if not answer.success:
            raise StackError(f"arming was refused: {answer.message}")
        wait_until(
            lambda: self.bridge.state != BridgeState.HOMING and self.bridge.state != BridgeState.DISARMED,
            60.0,
            "homing",
            self._stack,
        )
        if self.bridge.state != BridgeState.ARMED:
            raise StackError(f"homing ended in {self.bridge.state}: {self.bridge.reason}")

    def wait_for_duty(self, needed_s: float, limit_s: float) -> None:
        """Until every strut may run for `needed_s` of robot time again."""
        wait_until(lambda: self.bridge.duty_left_s >= needed_s, limit_s, "the actuators' rest", self._stack)

    def set_face(self, face: str) -> None:
        """Say which face the robot stands on, as a person sees it. StackError if the bridge does not take it."""
        wait_until(self._set_face.service_is_ready, DISCOVERY_LIMIT_S, "the bridge's service set_face", self._stack)
        self._require_alone()
        request = SetFace.Request(face=face, source=FaceObservation.SOURCE_OPERATOR)
        answer = self._result(self._set_face.call_async(request), 10.0, "an answer to set_face")
        if not answer.success:
            raise StackError(f"the bridge does not take the face: {answer.message}")

    def log_trial(self, record: TrialRecord) -> None:
        """Put a trial into the bag; on return it is on the disk. StackError if it is not."""
        wait_until(self._log_trial.service_is_ready, DISCOVERY_LIMIT_S, "the bridge's service log_trial", self._stack)
        self._require_alone()
        answer = self._result(self._log_trial.call_async(LogTrial.Request(record=record)), 20.0, "an answer to log_trial")
        if not answer.success:
            raise StackError(f"the trial is not in the bag: {answer.message}")

    def trigger(self, name: str) -> None:
        """Call `stop` or `reset`. StackError with the bridge's reason if it cannot be."""
        client = self._triggers[name]
        wait_until(client.service_is_ready, DISCOVERY_LIMIT_S, f"the bridge's service {name}", self._stack)
        if name != "stop":  # that one may well reach everybody
            self._require_alone()
        asked = [client.call_async(Trigger.Request())]
        began = time.monotonic()

        def answered() -> bool:
            if name == "stop" and time.monotonic() - began > len(asked) * STOP_AGAIN_S:  # one to a bridge not met yet is lost
                asked.append(client.call_async(Trigger.Request()))
            return any(future.done() for future in asked)

        wait_until(answered, 10.0, f"an answer to {name}", self._stack)
        answer = next(_shown(future.result()) for future in asked if future.done())
        if not answer.success:
            raise StackError(f"{name} failed: {answer.message}")

    def disarm(self) -> None:
        """Give the lease back; says nothing if nobody holds it."""
        self._result(self._disarm.call_async(Disarm.Request()), 10.0, "an answer to disarm")

    def roll(
        self,
        target: str,
        feedback: Callable[[Any], None],
        limit_s: float,
        source: str = "",
        primitive: str = "",
        watch: Callable[[], None] = lambda: None,
    ) -> Any:
        """Roll onto a face; the action's result. KeyboardInterrupt cancels it, which holds the struts, and goes on.

        Args:
            source, primitive: as in the action; empty: where it stands, and the planner's choice.
            watch: called all the while; may raise KeyboardInterrupt.
        """
        goal = Roll.Goal(target_face=target, source_face=source, primitive=primitive)
        return self._act(self._roll, "roll", goal, feedback, limit_s, watch)

    def travel(
        self, place_m: tuple[float, float], reach_m: float, most_rolls: int, feedback: Callable[[Any], None], limit_s: float
    ) -> Any:
        """Travel to a place on the floor; the action's result. KeyboardInterrupt cancels it, as in `roll`."""
        wait_until(self._travel.server_is_ready, DISCOVERY_LIMIT_S, "the traveller's action travel", self._stack)
        goal = Travel.Goal(reach_m=reach_m, most_rolls=most_rolls)
        goal.goal.header.frame_id = "odom"
        goal.goal.pose.position.x, goal.goal.pose.position.y = place_m
        return self._act(self._travel, "travel", goal, feedback, limit_s, lambda: None)

    def _act(
        self, client: ActionClient, name: str, goal: Any, feedback: Callable[[Any], None], limit_s: float, watch: Callable[[], None]
    ) -> Any:
        handle = self._called(
            lambda: client.send_goal_async(goal, feedback_callback=lambda message: feedback(message.feedback)),
            10.0,
            f"an answer to {name}",
        )
        if not handle.accepted:
            raise StackError(f"the {name} was rejected: another one is running; cancel that first")
        try:
            return _shown(self._called(handle.get_result_async, limit_s, f"the end of the {name}", watch).result)
        except KeyboardInterrupt:
            self._called(handle.cancel_goal_async, 10.0, "an answer to cancel")
            raise

    def _called(self, call: Callable[[], Any], limit_s: float, what: str, watch: Callable[[], None] = lambda: None) -> Any:
        """Make an action's call in the executor's thread (from another, its answer can arrive before it is waited for) and wait."""

        async def ask() -> Any:
            return await call()

        return self._result(self._executor.create_task(ask), limit_s, what, watch)

    def _result(self, future: Any, limit_s: float, what: str, watch: Callable[[], None] = lambda: None) -> Any:
        def done() -> bool:
            watch()
            return bool(future.done())

        wait_until(done, limit_s, what, self._stack)
        return _shown(future.result())

    def distance_m(self) -> tuple[float, float] | None:
        """Mean and largest distance between the twin's and the observed joints now; None if there is no observer."""
        twin, seen = self._twin_joints, self._seen_joints
        if twin is None or seen is None:
            return None
        apart = np.linalg.norm(twin - seen, axis=1)
        return float(apart.mean()), float(apart.max())


def _shown(message: Any) -> Any:
    """The same with its words fit for a terminal, whoever sent them."""
    for name in ("message", "reason", "lease_holder", "state"):
        if isinstance(words := getattr(message, name, None), str):
            setattr(message, name, printable(words, LONGEST_WORDS))
    return message
