# SPDX-License-Identifier: Apache-2.0
"""A client of the stack that also does what no command does: moves struts, holds the bridge's lease, calls at a known time."""

import threading
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hardware_bridge.errors import may_be_sent_again
from hardware_bridge.safety.lease_proof import Prover
from sim_core.names import STRUT_NAMES
from tensegrity_interfaces.action import ExecuteStruts, Roll
from tensegrity_interfaces.msg import LeaseProof
from tensegrity_interfaces.srv import Arm, Disarm, FaceGraph
from tensegrity_lab.errors import StackError, granted
from tensegrity_lab.stack.client import ARM_LIMIT_S, StackClient
from tensegrity_lab.stack.processes import START_LIMIT_S
from tensegrity_robot.ros import topics

MID_M = 0.234
"""Rest length of a strut at mid stroke."""
JUDGING_LIMIT_S = 60.0
MOST_SENDS = 5
SERVICES = {"bridge/arm": Arm, "bridge/disarm": Disarm, "face_graph": FaceGraph}


class Operator(StackClient):
    """See the module; keeps the bridge's events.

    Attributes:
        rehearsal: the newest; None before the first.
        diagnostics: the newest status of each part by name.
        feedback: phases of the last roll, in order.
        asked_ns: ROS time at which the last motion, cancel or `trigger_at` was asked for.
        lease: of the bridge, proven while it is set.
    """

    def __init__(self, *words: Any, **options: Any):
        self.rehearsal: Any = None
        self.diagnostics: dict[str, Any] = {}
        self.feedback: list[str] = []
        self.asked_ns = 0
        self.lease = self._proven = ""
        self._prover = Prover("")
        super().__init__(*words, **{"events": True} | options)
        topics.REHEARSAL.subscribe(self.node, self._on_rehearsal)
        topics.DIAGNOSTICS.subscribe(self.node, self._on_diagnostics)
        self._proof = topics.LEASE.publisher(self.node)
        self.node.create_timer(0.2, self._prove)
        self._clients |= {service: self.node.create_client(kind, service) for service, kind in SERVICES.items()}
        self._struts = ActionClient(self.node, ExecuteStruts, "execute_struts")

    # ---- hearing ----------------------------------------------------------------------------------------------------

    def _on_rehearsal(self, message: Any) -> None:
        self.rehearsal = message

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics.update({status.name: status for status in message.status})

    def _prove(self) -> None:
        if not self.lease:
            return
        if self._proven != self.lease:
            self._proven, self._prover = self.lease, Prover(self.lease)
        counter, proof = self._prover.next()
        self._proof.publish(LeaseProof(stamp=self.node.get_clock().now().to_msg(), counter=counter, proof=list(proof)))

    def diagnosis(self, part: str) -> dict[str, str]:
        """The newest values of a part of the bridge's diagnostics; none before the first."""
        status = self.diagnostics.get(f"hardware_bridge: {part}")
        return {} if status is None else {pair.key: pair.value for pair in status.values}

    def stroke_m(self) -> float:
        """How far the struts are from mid stroke, as far as is known."""
        return max((abs(length - MID_M) for message in self.sent[-1:] for length in message.length_m), default=0.0)

    @staticmethod
    def stamp_ns(message: Any) -> int:
        """ROS time of a message, in ns."""
        return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)

    # ---- waiting ----------------------------------------------------------------------------------------------------

    def is_quiet(self) -> bool:
        """The last that was seen of the robot is that it rests on a face, and nothing was written since."""
        return bool(self.rests() and self.observed.face)

    def sees(self, state: str, limit_s: float = 30.0) -> None:
        """Wait for a state of the bridge."""
        self.wait(lambda: self.bridge.state == state, f"{state} (now {self.bridge.state}: {self.bridge.reason})", limit_s)

    def moves(self, handle: Any, stroke_m: float) -> None:
        """Wait until a roll or motion has brought the struts this far from mid stroke; fail with its result if it ends before."""
        result = self.begun(handle.get_result_async)
        self.wait(lambda: self.stroke_m() > stroke_m or result.done(), f"motion ({self.feedback})", 30.0)
        if result.done():
            raise StackError(f"it ended before the struts moved: {result.result()}")

    def wrote_since(self, began_ns: int) -> bool:
        """Whether anything was written to the board since then, as the stream tells it up to now."""
        now_ns = self.now_ns()
        self.wait(lambda: self.sent and self.stamp_ns(self.sent[-1]) > now_ns, "the next heartbeat")
        return any(self.stamp_ns(message) > began_ns and not message.heartbeat for message in self.sent)

    def hears_more(self, count: int) -> None:
        """Wait for so many more events of the bridge's stream."""
        seq = self.sent[-1].seq if self.sent else 0
        self.wait(lambda: self.sent and self.sent[-1].seq > seq + count, f"{count} more events of the bridge")

    # ---- services ---------------------------------------------------------------------------------------------------

    def take_lease(self, confirmed_lengths_m: Sequence[float] = (), holder: str = "operator") -> str:
        """Arm the bridge itself and wait for the end of homing; the lease, which is then kept alive. StackError if refused."""
        lengths = list(confirmed_lengths_m)
        request = Arm.Request(holder=holder, lifted_and_clear=True, prototype=self.prototype, confirmed_lengths_m=lengths)
        self.lease = granted(self.call("bridge/arm", request, ARM_LIMIT_S), "arming was refused").lease
        self._home()
        return self.lease

    def trigger_at(self, name: str) -> int:
        """Call `stop` or `reset` once; the ROS time at which it was called, in ns."""
        client = self._ready(name)
        self._timed(lambda: client.call_async(Trigger.Request()), f"an answer to {name}")
        return self.asked_ns

    # ---- actions ----------------------------------------------------------------------------------------------------

    def send(self, client: ActionClient, goal: Any, name: str, tell: Callable[[Any], None]) -> Any:
        """See `StackClient`; the phases of a roll are kept."""
        if name != "roll":
            return super().send(client, goal, name, tell)
        self.feedback.clear()

        def note(feedback: Any) -> None:
            if not self.feedback or self.feedback[-1] != feedback.phase:
                self.feedback.append(feedback.phase)
            tell(feedback)

        return super().send(client, goal, name, note)

    def begin_roll(
        self,
        target: str,
        source: str = "",
        primitive: str = "",
        tell: Callable[[Any], None] = lambda feedback: None,
        anyway: bool = False,
    ) -> Any:
        """The goal handle of a roll. Args: as in `roll`; and anyway: although rehearsals say that it is unlikely to work."""
        goal = Roll.Goal(target_face=target, source_face=source, primitive=primitive, anyway=anyway)
        return self.send(self._roll, goal, "roll", tell)

    def cancel(self, handle: Any) -> Any:
        """The answer to a call that cancels an action."""
        return self._timed(handle.cancel_goal_async, "an answer to cancel")

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
        trajectory = JointTrajectory(joint_names=names or STRUT_NAMES)
        for time_s, lengths_m in knots:
            point = JointTrajectoryPoint(positions=lengths_m)
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(round(time_s * 1e9), 1_000_000_000)
            trajectory.points.append(point)
        goal = ExecuteStruts.Goal(trajectory=trajectory, lease=lease, library_hash=library_hash)
        running = threading.Event()

        def send() -> Any:
            self.asked_ns = self.now_ns()
            seconds, nanoseconds = divmod(self.asked_ns - round(age_s * 1e9), 1_000_000_000)
            trajectory.header.stamp.sec, trajectory.header.stamp.nanosec = seconds, nanoseconds
            return self._struts.send_goal_async(goal, feedback_callback=lambda _: running.set())

        self.wait(self._struts.server_is_ready, "the bridge's action execute_struts", START_LIMIT_S)
        for _ in range(MOST_SENDS):
            running.clear()
            handle = self.result(self.begun(send), "an answer to execute_struts")
            if once or age_s or not handle.accepted:
                break
            ended = self.begun(handle.get_result_async)
            over = lambda ended=ended: running.is_set() or ended.done()  # noqa: E731
            self.wait(over, "a verdict on a motion", JUDGING_LIMIT_S)
            if running.is_set() or not may_be_sent_again(ended.result().result.reason):
                break
        return handle

    def move(self, *knots: tuple[float, list[float]], **options: Any) -> Any:
        """The result of a whole motion of the struts."""
        return self.end(self.begin_motion(*knots, **options)).result

    def _timed(self, call: Callable[[], Any], what: str) -> Any:
        """The answer of a call, whose time is kept in `asked_ns`."""

        def ask() -> Any:
            self.asked_ns = self.now_ns()
            return call()

        return self.result(self.begun(ask), what)

    def in_executor(self, act: Callable[[], Any]) -> Any:
        """What an act returns. What is destroyed from another thread may be waited on, and would end the executor."""
        return self.result(self._spinner.executor.create_task(act), "the executor's attention")
