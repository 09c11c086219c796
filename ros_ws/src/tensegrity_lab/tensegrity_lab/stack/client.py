# SPDX-License-Identifier: Apache-2.0
"""The ROS client of the stack: arms, rolls, travels, watches. For commands; tests have one that can more."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from sim_core.printable import printable
from sim_core.twin.live_bridge import LiveBridge
from tensegrity_interfaces.action import Roll, Travel
from tensegrity_interfaces.msg import BridgeState, FaceObservation, TrialRecord, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, LogTrial, SetFace
from tensegrity_lab.errors import StackError, granted
from tensegrity_lab.stack.processes import START_LIMIT_S, Stack, wait_until
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.conversions import frame_prefix
from tensegrity_robot.ros.node_process import own_context

LONGEST_WORDS = 2000
ANSWER_LIMIT_S = 20.0
ARM_LIMIT_S = 40.0
"""The planner gives the bridge so long to load its judge of shapes, and a little more."""
HOMING_LIMIT_S = 60.0
STOP_AGAIN_S, RESET_AGAIN_S = 0.5, 3.0
LATE_LIMIT_S = 5.0
EVENTS = QoSProfile(depth=1000)
"""A client that a busy computer slows down hears late, but not ever later."""
SERVICES = {
    "arm": Arm,
    "disarm": Disarm,
    "stop": Trigger,
    "reset": Trigger,
    "set_face": SetFace,
    "log_trial": LogTrial,
}


class StackClient:
    """A node in a context of its own; every wait has a limit, and raises StackError after it.

    Attributes:
        bridge, twin, observed: newest bridge state, twin state and observed face; None before the first.
        heard: when (time.monotonic) the bridge was heard last.
        sent: every StrutsSent; only with `events`.
        prototype: instance of the virtual prototype that may be armed; empty: any robot.
    """

    def __init__(
        self,
        stack: Stack | None = None,
        prototype: str = "",
        domain: int | None = None,
        name: str = "sixstrut_operator",
        events: bool = False,
        namespace: str = "",
    ):
        """Join ROS.

        Args:
            stack: a wait ends with the death of any of its processes.
            prototype: nothing is heard or wanted of another one's bridge. Empty: whatever robot the stack has.
            domain: of ROS; None: the shell's, found as the nodes find each other.
            name: of the node.
            events: keep the bridge's events.
            namespace: of the stack.
        """
        self._stack, self._only, self.prototype = stack, prototype, prototype
        self._context = own_context(domain)
        self.node = node = Node(name, context=self._context, namespace=namespace)
        self.bridge: Any = None
        self.twin: Any = None
        self.observed: Any = None
        self.heard = 0.0
        self.sent: list[Any] = []
        self._wrote = "", 0
        self._joints: dict[str, np.ndarray] = {}
        self._live = LiveBridge(node.get_logger().warning)
        topics.BRIDGE_STATE.subscribe(node, self._on_bridge)
        topics.BRIDGE_FACE.subscribe(node, lambda face: self._live.takes(face, partial(setattr, self, "observed")))
        topics.TWIN_STATE.subscribe(node, self._on_twin)
        self._events = events
        if events:
            topics.STRUTS_SENT.subscribe(node, lambda sent: self._live.takes(sent, self._on_sent), EVENTS)
        self._clients = {service: node.create_client(kind, service) for service, kind in SERVICES.items()}
        self._roll = ActionClient(node, Roll, "roll")
        self._spinner = Spinner(node, self._context)

    def close(self) -> None:
        """Leave ROS."""
        self._spinner.close()
        self._context.try_shutdown()

    # ---- hearing ----------------------------------------------------------------------------------------------------

    def watch_joints(self) -> None:
        """Keep the twin's and the observer's newest joints from now on, for `distance_m`."""

        def keep(topic: str, message: PoseArray) -> None:
            self._joints[topic] = np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:12]])

        for topic in (topics.TWIN_JOINTS, topics.OBSERVED_JOINTS):
            topic.subscribe(self.node, partial(keep, topic.name))

    def _on_bridge(self, state: BridgeState) -> None:
        if self._only and state.prototype != self._only:
            return  # another robot's, or not proven yet
        if self._live.hears(state, self.now_ns()):  # otherwise a recording's
            self.bridge, self.heard = _shown(state), time.monotonic()

    def _on_twin(self, state: TwinState) -> None:
        self.twin = state

    def _on_sent(self, message: Any) -> None:
        self.sent.append(message)
        if not message.heartbeat:
            self._wrote = message.session, message.seq

    def distance_m(self) -> tuple[float, float] | None:
        """Mean and largest distance between the twin's and the observed joints now; None if there is no observer."""
        if len(self._joints) < 2:
            return None
        apart = np.linalg.norm(self._joints["twin/joints"] - self._joints["bridge/observed_joints"], axis=1)
        return float(apart.mean()), float(apart.max())

    def now_ns(self) -> int:
        """ROS time, which stamps are of."""
        return int(self.node.get_clock().now().nanoseconds)

    # ---- waiting ----------------------------------------------------------------------------------------------------

    def wait(self, condition: Callable[[], object], what: str, limit_s: float = ANSWER_LIMIT_S) -> None:
        """Wait for a condition. Raises StackError naming `what`, or a process of the stack that died."""
        wait_until(condition, limit_s, what, self._stack)

    def wait_for_bridge(self, observer: bool = True) -> None:
        """Until the bridge's port is open; and, with an observer, a face was seen."""
        self.wait(lambda: self.bridge is not None and self.bridge.link_ok, "the bridge's link", START_LIMIT_S)
        if observer:
            self.wait(lambda: self.observed is not None, "the first observed face", START_LIMIT_S)

    def wait_for_stack(self, observer: bool = True) -> None:
        """Until bridge, twin and planner are there; and, with an observer, a face was seen."""
        self.wait_for_bridge(observer)
        self.wait(lambda: self.twin is not None and self.twin.face, "the twin's first state", START_LIMIT_S)
        if self._events:
            self.wait(self._twin_follows, "a twin that follows", START_LIMIT_S)
        self.wait(self._clients["arm"].service_is_ready, "the planner's service arm", START_LIMIT_S)
        self.wait(self._roll.server_is_ready, "the planner's action roll", START_LIMIT_S)

    def wait_for_duty(self, needed_s: float, limit_s: float, watch: Callable[[], None] = lambda: None) -> None:
        """Until every strut may run for `needed_s` of robot time again. Args: watch: called all the while."""

        def rested() -> bool:
            watch()
            return bool(self.bridge.duty_left_s >= needed_s)

        self.wait(rested, "the actuators' rest", limit_s)

    def _twin_follows(self) -> bool:
        heard = ((message.seq, message.robot_time_ns) for message in self.sent[-1000:])
        return (self.twin.last_seq, self.twin.robot_time_ns) in heard

    def rests(self) -> bool:
        """The last that was seen of the robot is that it rests, on whatever face or none, and nothing was written since."""
        session, seq = self._wrote
        return bool(self.observed.settled and (self.observed.session != session or self.observed.seq > seq))

    # ---- services ---------------------------------------------------------------------------------------------------

    def call(self, name: str, request: Any, limit_s: float = ANSWER_LIMIT_S) -> Any:
        """The answer of a service."""
        return self.result(self._ready(name).call_async(request), f"an answer to {name}", limit_s)

    def _call_alone(self, name: str, request: Any, limit_s: float = ANSWER_LIMIT_S) -> Any:
        """The same, unless another bridge has come: with a virtual prototype, nothing is asked of two."""
        if self._only and self.node.count_publishers("bridge/state") > 1:
            raise StackError("another hardware bridge has come into this ROS domain: end it, then try again")
        return self.call(name, request, limit_s)

    def arm(self, confirmed_lengths_m: Sequence[float] = ()) -> None:
        """Arm through the planner and wait for the end of homing. StackError with the bridge's reason if refused."""
        lengths = list(confirmed_lengths_m)
        request = Arm.Request(holder="operator", lifted_and_clear=True, prototype=self.prototype, confirmed_lengths_m=lengths)
        granted(self._call_alone("arm", request, ARM_LIMIT_S), "arming was refused")
        self._home()

    def _home(self) -> None:
        answered = time.monotonic()

        def over() -> bool:
            failed = self.heard > answered and self.bridge.state in (BridgeState.FAULT, BridgeState.HOLD)
            return failed or self.bridge.state == BridgeState.ARMED

        self.wait(over, "the end of homing", HOMING_LIMIT_S)
        if self.bridge.state != BridgeState.ARMED:
            raise StackError(f"homing ended in {self.bridge.state}: {self.bridge.reason}")

    def disarm(self) -> None:
        """Give the lease back; says nothing if nobody holds it."""
        self.call("disarm", Disarm.Request())

    def set_face(self, face: str) -> None:
        """Say which face the robot stands on, as a person sees it. StackError if the bridge does not take it."""
        request = SetFace.Request(face=face, source=FaceObservation.SOURCE_OPERATOR)
        granted(self._call_alone("set_face", request), "the bridge does not take the face")

    def log_trial(self, record: TrialRecord) -> None:
        """Put a trial into the bag; on return it is on the disk. StackError if it is not."""
        granted(self._call_alone("log_trial", LogTrial.Request(record=record)), "the trial is not in the bag")

    def trigger(self, name: str) -> Any:
        """The answer of `stop` or `reset`, asked again if it does not come soon: a request to a server not met yet is lost."""
        client, again_s = self._ready(name), STOP_AGAIN_S if name == "stop" else RESET_AGAIN_S
        asked: list[Any] = []
        began = time.monotonic()

        def answered() -> bool:
            if time.monotonic() - began >= len(asked) * again_s:
                asked.append(client.call_async(Trigger.Request()))
            return any(future.done() for future in asked)

        self.wait(answered, f"an answer to {name}")
        if len(asked) > 1:  # one that was only late must not act after what the caller does next
            with suppress(StackError):
                self.wait(lambda: all(future.done() for future in asked), f"the late answers to {name}", LATE_LIMIT_S)
        return next(_shown(future.result()) for future in asked if future.done())

    def _ready(self, name: str) -> Any:
        self.wait(self._clients[name].service_is_ready, f"service {name}", START_LIMIT_S)
        return self._clients[name]

    # ---- actions ----------------------------------------------------------------------------------------------------

    def roll(
        self,
        target: str,
        source: str = "",
        primitive: str = "",
        tell: Callable[[Any], None] = lambda feedback: None,
        limit_s: float = 60.0,
        watch: Callable[[], None] = lambda: None,
        faces: Sequence[str] = (),
    ) -> Any:
        """Roll onto a face; the action's result. KeyboardInterrupt cancels it, which holds the struts, and goes on.

        Args:
            target: the face to roll onto.
            source: where it stands; empty: as known.
            primitive: name of one, or of a cycle; empty: the planner's choice.
            tell: told the feedback.
            limit_s: of the whole roll.
            watch: called all the while; may raise KeyboardInterrupt.
            faces: roll on over them; `target` is the last.
        """
        goal = Roll.Goal(target_face=target, source_face=source, primitive=primitive, faces=list(faces))
        return self._whole(self.send(self._roll, goal, "roll", tell), "roll", limit_s, watch)

    def travel(
        self, place_m: tuple[float, float], reach_m: float, most_rolls: int, tell: Callable[[Any], None], limit_s: float
    ) -> Any:
        """Travel to a place on the floor; the action's result. KeyboardInterrupt cancels it, as in `roll`."""
        goal = Travel.Goal(reach_m=reach_m, most_rolls=most_rolls)
        goal.goal.header.frame_id = frame_prefix(self.node) + "odom"
        goal.goal.pose.position.x, goal.goal.pose.position.y = place_m
        return self._whole(self.send(ActionClient(self.node, Travel, "travel"), goal, "travel", tell), "travel", limit_s)

    def _whole(self, handle: Any, name: str, limit_s: float, watch: Callable[[], None] = lambda: None) -> Any:
        if not handle.accepted:
            raise StackError(f"the {name} was rejected: another one is running; cancel that first")
        try:
            return self.end(handle, limit_s, f"the end of the {name}", watch).result
        except KeyboardInterrupt:
            self.cancel(handle)
            raise

    def end(
        self, handle: Any, limit_s: float = 60.0, what: str = "the end of the action", watch: Callable[[], None] = lambda: None
    ) -> Any:
        """The result of an action, with its status. Args: watch: called all the while."""
        answer = self.result(self.begun(handle.get_result_async), what, limit_s, watch)
        _shown(answer.result)
        return answer

    def cancel(self, handle: Any) -> Any:
        """The answer to a call that cancels an action."""
        return self.result(self.begun(handle.cancel_goal_async), "an answer to cancel")

    # ---- calls from the executor's thread ---------------------------------------------------------------------------

    def send(self, client: ActionClient, goal: Any, name: str, tell: Callable[[Any], None]) -> Any:
        """The handle of a goal, once its server is there. Args: name: of the action; tell: told the feedback."""
        self.wait(client.server_is_ready, f"the action {name}", START_LIMIT_S)
        send = partial(client.send_goal_async, goal, feedback_callback=lambda message: tell(message.feedback))
        return self.result(self.begun(send), f"an answer to {name}")

    def begun(self, call: Callable[[], Any]) -> Any:
        """The future of a call's answer: from another thread, that can arrive before rclpy knows that somebody waits for it."""

        async def ask() -> Any:
            return await call()

        return self._spinner.executor.create_task(ask)

    def result(self, future: Any, what: str, limit_s: float = ANSWER_LIMIT_S, watch: Callable[[], None] = lambda: None) -> Any:
        """What a future holds at last. Args: watch: called all the while."""

        def done() -> bool:
            watch()
            return bool(future.done())

        self.wait(done, what, limit_s)
        return _shown(future.result())


def _shown(message: Any) -> Any:
    """The same with its words fit for a terminal, whoever sent them."""
    for name in ("message", "reason", "lease_holder", "state"):
        if isinstance(words := getattr(message, name, None), str):
            setattr(message, name, printable(words, LONGEST_WORDS))
    return message
