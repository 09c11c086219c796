"""Somebody at the robot: a ROS client that arms, rolls, commands and watches; every wait has a limit."""

from __future__ import annotations

import threading
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
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hardware_bridge.errors import may_be_sent_again
from hardware_bridge.proofs import Prover
from sixstrut_cli.faults.processes import START_LIMIT_S, wait_until
from tensegrity_interfaces.action import ExecuteStruts, Roll
from tensegrity_interfaces.msg import BridgeState, FaceObservation, LeaseProof, Rehearsal, StrutsSent, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, FaceGraph, SetFace
from tensegrity_robot.live_bridge import LiveBridge

ANSWER_LIMIT_S = 15.0
JUDGING_LIMIT_S = 60.0
MOST_SENDS = 5
LATE_LIMIT_S = 5.0
LATCHED = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Operator:
    """A client in a context of its own.

    Attributes:
        bridge, twin, face, rehearsal: newest bridge state, twin state, observed face and rehearsal; None before the first.
        diagnostics: newest status of each part, by name.
        sent: every StrutsSent heard.
        feedback: phases of the last roll, in order.
        lease: proven by `keep_alive` while set.
        prototype: instance of the virtual prototype that may be armed; empty: any robot.
    """

    def __init__(self, domain: int):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("test_operator", context=self._context)
        self.bridge: Any = None
        self.twin: Any = None
        self.face: Any = None
        self.rehearsal: Any = None
        self.diagnostics: dict[str, Any] = {}
        self.sent: list[Any] = []
        self.feedback: list[str] = []
        self.lease = self._proven = self.prototype = ""
        self._prover = Prover("")
        subscribe = self.node.create_subscription
        self._live = live = LiveBridge(lambda words: None)
        subscribe(BridgeState, "bridge/state", self._on_state, LATCHED)
        subscribe(TwinState, "twin/state", lambda message: setattr(self, "twin", message), 10)
        subscribe(FaceObservation, "bridge/face", lambda face: live.takes(face, partial(setattr, self, "face")), LATCHED)
        subscribe(Rehearsal, "rehearsal", lambda message: setattr(self, "rehearsal", message), LATCHED)
        subscribe(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        subscribe(StrutsSent, "bridge/struts_sent", lambda sent: live.takes(sent, self.sent.append), 1000)
        self._proof = self.node.create_publisher(LeaseProof, "bridge/lease", 10)
        self.node.create_timer(0.2, self._keep_alive)
        self._clients = {
            name: self.node.create_client(kind, name)
            for name, kind in {
                "arm": Arm,
                "disarm": Disarm,
                "bridge/arm": Arm,
                "bridge/disarm": Disarm,
                "stop": Trigger,
                "reset": Trigger,
                "set_face": SetFace,
                "face_graph": FaceGraph,
            }.items()
        }
        self._roll = ActionClient(self.node, Roll, "roll")
        self._struts = ActionClient(self.node, ExecuteStruts, "execute_struts")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _on_state(self, state: BridgeState) -> None:
        if self._live.hears(state, self.now_ns()):
            self.bridge = state

    def _keep_alive(self) -> None:
        if not self.lease:
            return
        if self._proven != self.lease:
            self._proven, self._prover = self.lease, Prover(self.lease)
        counter, proof = self._prover.next()
        self._proof.publish(LeaseProof(stamp=self.node.get_clock().now().to_msg(), counter=counter, proof=list(proof)))

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join(5.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics.update({status.name: status for status in message.status})

    def diagnosis(self, part: str) -> dict[str, str]:
        """The newest values of a part of the bridge's diagnostics; none before the first."""
        status = self.diagnostics.get(f"hardware_bridge: {part}")
        return {} if status is None else {pair.key: pair.value for pair in status.values}

    # ---- waiting ----------------------------------------------------------------------------------------------------

    def meets_stack(self) -> None:
        """Wait until bridge, twin and planner are there and somebody has seen the robot."""
        wait_until(lambda: self.bridge is not None and self.bridge.link_ok, START_LIMIT_S, "the bridge's link")
        wait_until(lambda: self.face is not None, START_LIMIT_S, "an observed face")
        wait_until(self._twin_follows, START_LIMIT_S, "a twin that follows")
        wait_until(self._roll.server_is_ready, START_LIMIT_S, "the planner")

    def _twin_follows(self) -> bool:
        twin = self.twin
        heard = ((message.seq, message.robot_time_ns) for message in self.sent[-1000:])
        return twin is not None and (twin.last_seq, twin.robot_time_ns) in heard

    def is_quiet(self) -> bool:
        """The last that was seen of the robot is that it rests, and nothing was written since."""
        writes = [message.seq for message in self.sent if not message.heartbeat]
        return bool(self.face.settled and self.face.face and (not writes or self.face.seq > writes[-1]))

    def sees(self, state: str, limit_s: float = 30.0) -> None:
        """Wait for a state of the bridge."""
        wait_until(lambda: self.bridge.state == state, limit_s, f"{state} (now {self.bridge.state}: {self.bridge.reason})")

    def moves(self, handle: Any, stroke_m: float) -> None:
        """Wait until a roll or motion has brought the struts this far from neutral; fail with its result if it ends before."""
        result = self.from_executor(handle.get_result_async)
        wait_until(lambda: self.stroke_m() > stroke_m or result.done(), 30.0, f"motion ({self.feedback})")
        assert not result.done(), result.result()

    def wrote_since(self, began_ns: int) -> bool:
        """Whether anything was written to the board since then, as the stream tells it up to now."""
        now_ns = self.now_ns()
        wait_until(lambda: self.sent and self.stamp_ns(self.sent[-1]) > now_ns, 20.0, "the next heartbeat")
        return any(self.stamp_ns(message) > began_ns and not message.heartbeat for message in self.sent)

    @staticmethod
    def stamp_ns(message: Any) -> int:
        """ROS time of a message, in ns."""
        return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)

    def hears_more(self, count: int) -> None:
        """Wait for so many more events of the bridge's stream."""
        seq = self.sent[-1].seq if self.sent else 0
        wait_until(lambda: self.sent and self.sent[-1].seq > seq + count, 20.0, f"{count} more events of the bridge")

    def now_ns(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def stroke_m(self) -> float:
        """How far the struts are from neutral, as far as is known."""
        return max((abs(length - 0.234) for message in self.sent[-1:] for length in message.length_m), default=0.0)

    # ---- calling ----------------------------------------------------------------------------------------------------

    def call(self, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self._clients[name]
        wait_until(client.service_is_ready, START_LIMIT_S, f"service {name}")
        return self._result(client.call_async(request), f"the answer of {name}")

    def trigger(self, name: str) -> Any:
        """Call `stop` or `reset`; what is not answered soon is asked again, because a request to a server not met yet is lost."""
        client = self._clients[name]
        wait_until(client.service_is_ready, START_LIMIT_S, f"service {name}")
        asked = []
        for _ in range(MOST_SENDS):
            asked.append(client.call_async(Trigger.Request()))
            try:
                wait_until(partial(_any, *(future.done for future in asked)), ANSWER_LIMIT_S / MOST_SENDS, f"the answer of {name}")
                break
            except AssertionError:
                if len(asked) == MOST_SENDS:
                    raise
        if len(asked) > 1:  # one that was only late must not act after what the caller does next
            with suppress(AssertionError):
                wait_until(lambda: all(future.done() for future in asked), LATE_LIMIT_S, f"the late answers of {name}")
        return next(future.result() for future in asked if future.done())

    def trigger_at(self, name: str) -> int:
        """As `trigger`; the ROS time at which it was called, in ns."""
        client = self._clients[name]
        wait_until(client.service_is_ready, START_LIMIT_S, f"service {name}")
        called: list[int] = []

        def ask() -> Any:
            called.append(self.now_ns())
            return client.call_async(Trigger.Request())

        self._result(self.from_executor(ask), f"the answer of {name}")
        return called[0]

    def arm(self) -> None:
        """Through the planner, until ARMED."""
        answer = self.call("arm", Arm.Request(holder="test", lifted_and_clear=True, prototype=self.prototype))
        assert answer.success, answer.message
        self.sees(BridgeState.ARMED)

    def begin_roll(self, target: str, source: str = "", primitive: str = "", anyway: bool = False) -> Any:
        """The goal handle of a roll."""
        self.feedback.clear()
        wait_until(self._roll.server_is_ready, START_LIMIT_S, "the planner")
        goal = Roll.Goal(target_face=target, source_face=source, primitive=primitive, anyway=anyway)
        return self.send(self._roll, goal, "the answer to roll", self._on_feedback)

    def _on_feedback(self, message: Any) -> None:
        if not self.feedback or self.feedback[-1] != message.feedback.phase:
            self.feedback.append(message.feedback.phase)

    def end(self, handle: Any, limit_s: float = 60.0) -> Any:
        """The result of an action, with its status."""
        return self._result(self.from_executor(handle.get_result_async), "the end of the action", limit_s)

    def roll(self, target: str, source: str = "", primitive: str = "", anyway: bool = False) -> Any:
        """The result of a whole roll."""
        return self.end(self.begin_roll(target, source, primitive, anyway)).result

    def cancel(self, handle: Any) -> Any:
        return self._result(self.from_executor(handle.cancel_goal_async), "the answer to cancel")

    def begin_motion(
        self,
        *knots: tuple[float, list[float]],
        lease: str = "",
        age_s: float = 0.0,
        names: Any = None,
        library_hash: str = "",
        once: bool = False,
    ) -> Any:
        """The goal handle of a motion of the struts; knots are (time in s, six rest lengths in m).

        It is under way or refused when this returns: a motion that the bridge took longer to judge than its stamp is good for is
        sent again. Not with an age of its own, or `once`.
        """
        trajectory = JointTrajectory(joint_names=names or [f"S{number}" for number in range(1, 7)])
        for time_s, lengths_m in knots:
            point = JointTrajectoryPoint(positions=lengths_m)
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(round(time_s * 1e9), 1_000_000_000)
            trajectory.points.append(point)
        wait_until(self._struts.server_is_ready, START_LIMIT_S, "execute_struts")
        goal = ExecuteStruts.Goal(trajectory=trajectory, lease=lease, library_hash=library_hash)
        for _ in range(MOST_SENDS):
            stamp, running = self.node.get_clock().now().nanoseconds - round(age_s * 1e9), threading.Event()
            trajectory.header.stamp.sec, trajectory.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            handle = self.send(self._struts, goal, "the answer to execute_struts", partial(_set, running))
            if once or age_s or not handle.accepted:
                break
            result = self.from_executor(handle.get_result_async)
            wait_until(partial(_any, running.is_set, result.done), JUDGING_LIMIT_S, "a verdict")
            if running.is_set() or not may_be_sent_again(result.result().result.reason):
                break
        return handle

    def move(self, *knots: tuple[float, list[float]], **options: Any) -> Any:
        """The result of a whole motion of the struts."""
        return self.end(self.begin_motion(*knots, **options)).result

    def send(self, client: ActionClient, goal: Any, what: str, on_feedback: Any = None) -> Any:
        """The handle of a goal."""
        return self._result(self.from_executor(lambda: client.send_goal_async(goal, feedback_callback=on_feedback)), what)

    def from_executor(self, ask: Callable[[], Any]) -> Any:
        """The answer to what is asked in the executor's thread.

        From another thread the answer may come before rclpy knows that somebody waits for it. The same holds for whatever is
        destroyed: the executor may be waiting on it, and would end with InvalidHandle.
        """
        return self._result(self._executor.create_task(ask), "the executor's attention")

    def _result(self, future: Any, what: str, limit_s: float = ANSWER_LIMIT_S) -> Any:
        wait_until(future.done, limit_s, what)
        return future.result()


def _set(event: threading.Event, _message: Any) -> None:
    event.set()


def _any(*conditions: Callable[[], bool]) -> bool:
    return any(condition() for condition in conditions)
