"""The hardware bridge's node: a lifecycle node around `hardware_bridge.Bridge`, with the session's bag.

One executor thread takes calls; frames, observer and disk have threads of their own, so that nothing slow stands before `stop`.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from hardware_bridge.bridge import Bridge
from hardware_bridge.calibration import load_calibration
from hardware_bridge.checks import Rules
from hardware_bridge.codecs.registry import parse_board
from hardware_bridge.errors import BridgeError, PortMissing, Refused, StateError
from hardware_bridge.events import FaceEvent, SentEvent, Snapshot
from hardware_bridge.limits import Limits, Pacing
from hardware_bridge.motion import MotionHandle
from hardware_bridge.observation import Observation
from hardware_bridge.observer_client import ObserverClient
from hardware_bridge.virtual_port import default_link, read_handshake
from sim_core.errors import SimError
from sim_core.library import libraries_folder, load_library
from sim_core.parameters import default_path, load_prototype
from sim_core.structure import STRUTS
from tensegrity_interfaces.action import ExecuteStruts
from tensegrity_interfaces.msg import BridgeState, FaceObservation, LeaseProof, StrutsSent, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, SetFace
from tensegrity_robot import bridge_messages, messages, qos
from tensegrity_robot.bridge_messages import LogFacts
from tensegrity_robot.cdr import wire_bytes
from tensegrity_robot.errors import StartError
from tensegrity_robot.filters import EventTimes, ObservationFilter
from tensegrity_robot.parameters import declare_parameters, parameter
from tensegrity_robot.process import End, run
from tensegrity_robot.session_log import SessionLog, bag_folder, mend_journals

FEEDBACK_PERIOD_S = 0.1
STATE_PERIOD_S = 0.5
OBSERVED_PERIOD_S = 0.04
"""Wall time between published observations of joints; a fast virtual prototype makes more of them."""
NO_PROTOTYPE = "no virtual prototype is running: start one with `ros2 run tensegrity_robot virtual_prototype`, or give a port"

UNCALIBRATED = (
    "a real port, but the calibration is the virtual prototype's: measure the robot's own (copy calibration_default.yaml) and "
    "start the bridge with calibration:=FILE"
)

SET_ON_THE_BOARD = (
    "what cannot be set from here, and must be set in Pololu's Control Center: home of the six channels on Ignore, speed and "
    "acceleration 0, serial time-out {:g} s"
)


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of the bridge; the descriptions are what `ros2 param describe` shows."""

    port: str = parameter("", "device or pyserial URL of the board; empty: the virtual prototype's well-known link")
    board: str = parameter(
        "lsc", "servo board: lsc, ssc32 or maestro, the last with :device=N (Pololu protocol) and :crc if so set"
    )
    baud: int = parameter(0, "rate of board and port [baud]; 0: the board's usual, lsc 9600, else 115200", low=0, high=1_000_000)
    observer: str = parameter("", "Unix socket of an observer; empty: the virtual prototype's own, if the port is its")
    time_scale: float = parameter(
        0.0, "robot seconds per second; 0: what the port has: the virtual prototype its own, a real port 1", low=0.0, high=100.0
    )
    calibration: str = parameter("", "calibration YAML; empty: the virtual prototype's")
    stroke_limit_m: float = parameter(0.045, "largest change of a strut from mid stroke [m]", low=0.001, high=0.1)
    speed_limit_m_s: float = parameter(0.02, "largest speed of a strut [m/s of robot time]", low=0.001, high=0.1)
    frame_period_s: float = parameter(0.05, "time between frames to the board [s of robot time]", low=0.03, high=0.5)
    homing_speed_m_s: float = parameter(0.008, "speed of the slow move to mid stroke [m/s]", low=0.0005, high=0.02)
    goal_age_s: float = parameter(0.5, "oldest stamp of a motion [s]", low=0.05, high=5.0)
    lease_silence_s: float = parameter(1.0, "longest silence of the lease's holder [s]", low=0.2, high=10.0)
    state_folder: str = parameter("", "where the last pulses are kept; empty: $SIXSTRUT_STATE_DIR or ~/.local/state/sixstrut")
    record: bool = parameter(True, "record the session as a bag")
    bag_folder: str = parameter("", "where bags go; empty: $SIXSTRUT_BAGS or ./bags")
    library: str = parameter("robust", "gait library whose file goes into the bag: a shipped name, or a path")
    prototype_file: str = parameter("", "YAML of the robot's numbers that goes into the bag; empty: the nominal prototype")
    frame: str = parameter("odom", "frame of observed joints")
    autostart: bool = parameter(True, "open the port and go active at once; nothing moves")


class HardwareBridgeNode(LifecycleNode):
    """See the module."""

    def __init__(self, end: End):
        super().__init__("hardware_bridge")
        self._end = end
        self._settings = p = declare_parameters(self, BridgeParameters)
        self._bridge: Bridge | None = None
        self._log: SessionLog | None = None
        self._observer: ObserverClient | None = None
        self._observer_there: bool | None = None
        self._news = ObservationFilter()
        self._times = EventTimes()
        self._seen_lengths_m: tuple[float, ...] | None = None
        self._observed_at = 0.0
        self._active = False
        self._lease = ""
        self._motions: list[tuple[ServerGoalHandle, MotionHandle, Future]] = []
        self._failure: BridgeError | None = None
        self._hint = f"unconfigured: ros2 lifecycle set {self.get_fully_qualified_name()} configure"
        self._hinted = False
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._make_topics()
        self._make_calls()
        self.create_timer(FEEDBACK_PERIOD_S, self._attend_motions, clock=self._steady)
        self.create_timer(STATE_PERIOD_S, self._publish_state, clock=self._steady)
        self.create_timer(1.0, self._each_second, clock=self._steady)
        if p.autostart:
            failure = self._autostart()
            if failure is not None:
                self.close()
                raise StartError(str(failure)) from failure

    def _make_topics(self) -> None:
        self._types: dict[str, tuple[str, bool]] = {}
        self._asked = self._recorded_publisher(JointTrajectory, "bridge/asked", qos.STATES)
        self._sent = self._recorded_publisher(StrutsSent, "bridge/struts_sent", qos.STREAM)
        self._face = self._recorded_publisher(FaceObservation, "bridge/face", qos.FACES)
        self._state = self._recorded_publisher(BridgeState, "bridge/state", qos.LATCHED)
        self._joint_states = self._recorded_publisher(JointState, "bridge/joint_states", qos.STATES)
        self._observed = self._recorded_publisher(PoseArray, "bridge/observed_joints", qos.STATES)
        self._diagnostics = self._recorded_publisher(DiagnosticArray, "/diagnostics", qos.STATES)
        self._record_topic(TwinState, "twin/state", qos.STATES, self._follows_this_stream)
        self._record_topic(FaceObservation, "twin/face", qos.FACES)
        self._record_topic(JointState, "twin/joint_states", qos.STATES)
        self.create_subscription(LeaseProof, "bridge/lease", self._on_proof, qos.STATES)

    def _make_calls(self) -> None:
        self._server = ActionServer(self, ExecuteStruts, "execute_struts", self._execute, cancel_callback=self._on_cancel)
        self.create_service(Trigger, "stop", self._on_stop)
        self.create_service(Arm, "bridge/arm", self._on_arm)
        self.create_service(Disarm, "bridge/disarm", self._on_disarm)
        # It waits for the port; in the node's own group everything else would wait with it.
        self.create_service(Trigger, "reset", self._on_reset, callback_group=ReentrantCallbackGroup())
        self.create_service(SetFace, "set_face", self._on_set_face)

    # ---- life -------------------------------------------------------------------------------------------------------

    def _mend_journals(self) -> None:
        for line in mend_journals(bag_folder(self._settings.bag_folder)):
            self.get_logger().info(line)

    def halt(self) -> None:
        """Hold the struts and let go of the port, whatever the callbacks are doing."""
        self._active = False
        if self._bridge is not None:
            try:
                self._bridge.close()
            except BridgeError as error:
                self.get_logger().error(str(error))

    def close(self) -> None:
        """Ends threads and closes the bag."""
        self._close_bridge()
        self._server.destroy()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Opens port and bag. Nothing moves."""
        try:
            self._open_bridge()
        except (BridgeError, SimError, OSError) as error:
            self._failure = error if isinstance(error, BridgeError) else BridgeError(str(error))
            self._close_bridge()
            if not self._settings.autostart:
                self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._failure = None
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Commands are taken from now on; the supervisor stays DISARMED."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ends any motion, struts held, and takes the lease back."""
        self._active = False
        self._let_go()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Closes port and bag."""
        self._close_bridge()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Closes port and bag and ends the process."""
        self._active = False
        self._close_bridge()
        self._end(0)
        return super().on_shutdown(state)

    def _autostart(self) -> BridgeError | None:
        """To active; without a port and without a prototype, later. Returns what else goes wrong."""
        if not self._settings.port and read_handshake(str(default_link())) is None:
            self._hint = NO_PROTOTYPE
            if not self._hinted:
                self._hinted = True
                self.get_logger().warning(NO_PROTOTYPE)
            return None
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self._hinted = False  # from now on its life is the operator's
            self.trigger_activate()
            return None
        ended_meanwhile = isinstance(self._failure, PortMissing) and not self._settings.port
        return None if ended_meanwhile else self._failure

    def _open_bridge(self) -> None:
        p = self._settings
        port = p.port or str(default_link())
        rules = Rules(
            load_calibration(p.calibration or None),
            Limits(p.stroke_limit_m, p.speed_limit_m_s, goal_age_s=p.goal_age_s, lease_silence_s=p.lease_silence_s),
            Pacing(p.frame_period_s, homing_speed_m_s=p.homing_speed_m_s),
        )
        attachments, facts = _session_files(p) if p.record else ({}, {})
        self._news, self._seen_lengths_m, self._times = ObservationFilter(), None, EventTimes()
        self._log = SessionLog(self._on_log_fault) if p.record else None
        bridge = Bridge(
            port,
            rules,
            board=parse_board(p.board),
            baud=p.baud or None,
            time_scale=p.time_scale or None,
            state_dir=Path(p.state_folder) if p.state_folder else None,
            on_sent=self._on_bridge_sent,
            on_face=self._on_bridge_face,
            on_state=self._on_bridge_state,
        )
        bridge.open()
        self._bridge = bridge
        snapshot = bridge.snapshot()
        kind = "the virtual prototype" if snapshot.virtual_port else "a real port"
        if self._log is not None:
            facts |= {"port": port, "kind": kind, "board": bridge.board.spec}
            facts |= {"time_scale": f"{snapshot.time_scale:g}", "calibration": rules.calibration.hash}
            self._log.open(bag_folder(p.bag_folder), self._types, attachments, facts)
            threading.Thread(target=self._mend_journals, name="mend", daemon=True).start()
        observer = p.observer or bridge.observer
        if observer:
            self._observer_there = False
            self._observer = ObserverClient(observer, self._on_observation, self._on_observer)
        bag = f", recording {self._log.path}" if self._log else ", not recording"
        self.get_logger().info(
            f"{kind} at {port}, board {bridge.board.spec}, time scale {snapshot.time_scale:g}{bag}; DISARMED, nothing moves"
        )
        if bridge.board_timeout_s is not None and not snapshot.virtual_port:
            self.get_logger().info(SET_ON_THE_BOARD.format(bridge.board_timeout_s))
        self._publish_diagnostics()

    def _close_bridge(self) -> None:
        bridge, self._bridge = self._bridge, None
        observer, self._observer, self._observer_there = self._observer, None, None
        log, self._log = self._log, None
        try:
            if bridge is not None:
                self._log = log  # its last events
                bridge.close()
        except BridgeError as error:
            self.get_logger().error(str(error))
        finally:
            self._log = None
        if observer is not None:
            observer.close()
        if log is not None:
            try:
                log.close()
            except BridgeError as error:
                self.get_logger().error(str(error))
        self._finish_motions()

    # ---- what the bridge tells, from its own threads, in order --------------------------------------------------------

    def _on_bridge_sent(self, event: SentEvent) -> None:
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._settings.frame)
        self._publish(self._sent, bridge_messages.struts_sent(event, header))
        self._publish(self._joint_states, messages.joint_states(header.stamp, np.array(event.lengths_m)))
        self._times.add(event.seq, event.robot_time_ns)
        if not event.heartbeat:
            self._news.moved()

    def _on_bridge_face(self, event: FaceEvent) -> None:
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._settings.frame)
        self._times.add(event.seq, event.robot_time_ns)
        self._publish(self._face, bridge_messages.face_observation(event, header))

    def _on_bridge_state(self, snapshot: Snapshot) -> None:
        self._tell_state(snapshot)
        if self.executor is not None:
            self.executor.create_task(self._attend_motions)

    def _on_observation(self, observation: Observation) -> None:
        bridge = self._bridge
        if bridge is None:
            return
        ends = np.array(STRUTS)
        ways_m = observation.joints_m[ends[:, 1]] - observation.joints_m[ends[:, 0]]
        self._seen_lengths_m = tuple(float(length) for length in np.linalg.norm(ways_m, axis=1))
        if self._news.is_news(observation.face, observation.settled):
            try:
                source = FaceObservation.SOURCE_EXTERNAL if self._settings.observer else FaceObservation.SOURCE_PROTOTYPE
                bridge.observe_face(observation.face or "", source, observation.settled, observation.detail)
            except StateError:
                return  # closed in the meantime
            except BridgeError as error:
                self.get_logger().warning(f"observation not used: {error}", throttle_duration_sec=5.0)
        if time.monotonic() - self._observed_at >= OBSERVED_PERIOD_S:
            self._observed_at = time.monotonic()
            header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._settings.frame)
            self._publish(self._observed, bridge_messages.observed_joints(observation, header))

    def _on_observer(self, there: bool) -> None:
        self._observer_there = there

    def _on_log_fault(self, problem: str) -> None:
        self.get_logger().error(f"the log is dead: {problem}")

    # ---- calls ------------------------------------------------------------------------------------------------------

    def _ready(self) -> Bridge:
        """The bridge, if commands are taken. Raises Refused."""
        if self._bridge is None:
            raise Refused(self._hint)
        if not self._active:
            raise Refused(f"the bridge is inactive: ros2 lifecycle set {self.get_fully_qualified_name()} activate")
        return self._bridge

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        bridge = self._bridge
        if bridge is None:
            response.success, response.message = True, "there is no open port, nothing can move"
            return response
        bridge.stop()
        self._lease = ""
        response.success, response.message = True, "FAULT is latched until reset; if anything still moves, cut the servo supply"
        return response

    def _on_arm(self, request: Arm.Request, response: Arm.Response) -> Arm.Response:
        try:
            bridge = self._ready()
            if self._log is not None and self._log.fault:
                raise Refused(f"the log is dead ({self._log.fault}): start the bridge again, or without a log (record:=false)")
            if not self._settings.calibration and not bridge.snapshot().virtual_port:
                raise Refused(UNCALIBRATED)
            lengths = list(request.confirmed_lengths_m) or self._lengths_seen(bridge.snapshot())
            self._lease = response.lease = bridge.arm(request.holder or "somebody", request.lifted_and_clear, lengths)
            response.success, response.message = True, "homing has begun; wait for ARMED in bridge/state"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _lengths_seen(self, snapshot: Snapshot) -> list[float | None] | None:
        """For struts whose length nobody knows: as an observer sees them, if there is one."""
        seen = self._seen_lengths_m
        if all(snapshot.known) or seen is None or not self._observer_there:
            return None
        return [None if known else length for known, length in zip(snapshot.known, seen, strict=True)]

    def _on_disarm(self, request: Disarm.Request, response: Disarm.Response) -> Disarm.Response:
        try:
            self._ready().disarm(request.lease)
            response.success, response.message = True, "DISARMED; the struts hold"
        except BridgeError as error:
            response.message = str(error)
        return response

    async def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            bridge = self._ready()
            await self._elsewhere(bridge.reset)  # it may have to open the port again, which can take seconds
            response.success, response.message = True, "DISARMED; arm again"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _on_set_face(self, request: SetFace.Request, response: SetFace.Response) -> SetFace.Response:
        try:
            if self._bridge is None:
                raise Refused(self._hint)
            event = self._bridge.observe_face(request.face, request.source or FaceObservation.SOURCE_OPERATOR, True, "set_face")
            response.success, response.message = True, f"event {event.seq}: the robot stands on {request.face or 'no face'}"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _on_proof(self, message: LeaseProof) -> None:
        if self._bridge is None:
            return
        try:
            self._bridge.prove(message.lease)
        except BridgeError as error:
            self.get_logger().debug(str(error))

    def _elsewhere(self, work: Callable[[], None]) -> Awaitable[None]:
        """Runs `work` in a thread; the executor goes on meanwhile."""
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
            if self.executor is not None:
                self.executor.create_task(finish, error)

        threading.Thread(target=body, name="reset", daemon=True).start()
        return done

    # ---- execute_struts ---------------------------------------------------------------------------------------------

    async def _execute(self, goal: ServerGoalHandle) -> ExecuteStruts.Result:
        request = goal.request
        try:
            bridge = self._ready()
            age_s = (self.get_clock().now().nanoseconds - messages.nanoseconds(request.trajectory.header.stamp)) * 1e-9
            trajectory = bridge_messages.trajectory_of(request.trajectory)
            motion = bridge.execute(trajectory, request.lease, age_s)
        except BridgeError as error:
            self.get_logger().warning(f"motion refused: {error}")
            goal.abort()
            return ExecuteStruts.Result(reason=str(error), length_m=self._lengths())
        self._publish(self._asked, request.trajectory)
        if goal.is_cancel_requested:
            motion.cancel("cancelled by its commander")
        done: Future = Future()
        self._motions.append((goal, motion, done))
        await done
        result = motion.result()
        if result is not None and result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        if result is None:
            return ExecuteStruts.Result(reason="the bridge was closed", length_m=self._lengths())
        return ExecuteStruts.Result(success=result.success, reason=result.reason, length_m=result.lengths_m)

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        for running, motion, _ in self._motions:
            if running is goal:
                motion.cancel("cancelled by its commander")
        return CancelResponse.ACCEPT

    def _attend_motions(self) -> None:
        """Feedback, and the ends of motions."""
        for goal, motion, done in list(self._motions):
            if motion.result() is not None:
                self._motions.remove((goal, motion, done))
                done.set_result(None)
            elif goal.is_active and self._bridge is not None:
                progress = motion.progress()
                mode = str(self._bridge.snapshot().mode)
                goal.publish_feedback(ExecuteStruts.Feedback(state=mode, progress=progress.fraction, length_m=progress.lengths_m))

    def _finish_motions(self) -> None:
        for _, _, done in self._motions:
            done.set_result(None)
        self._motions.clear()

    def _let_go(self) -> None:
        if self._bridge is not None and self._lease:
            try:
                self._bridge.disarm(self._lease)
            except BridgeError as error:
                self.get_logger().info(str(error))
        self._lease = ""

    def _lengths(self) -> tuple[float, ...]:
        return self._bridge.snapshot().lengths_m if self._bridge is not None else (float("nan"),) * 6

    # ---- publishing and recording -----------------------------------------------------------------------------------

    def _recorded_publisher(self, kind: Any, topic: str, profile: QoSProfile) -> tuple[Publisher, str, str]:
        publisher = self.create_publisher(kind, topic, profile)
        type_name = _type_name(kind)
        self._types[publisher.topic_name] = (type_name, profile in (qos.FACES, qos.LATCHED))
        return publisher, publisher.topic_name, type_name

    def _record_topic(
        self, kind: Any, topic: str, profile: QoSProfile, wanted: Callable[[bytes], bool] = lambda data: True
    ) -> None:
        """Record what another node publishes, if it is wanted."""
        name, type_name = self.resolve_topic_name(topic), _type_name(kind)
        self._types[name] = (type_name, profile in (qos.FACES, qos.LATCHED))

        def record(data: bytes) -> None:
            if self._log is not None and wanted(data):
                self._log.write(name, type_name, data, self.get_clock().now().nanoseconds)

        self.create_subscription(kind, topic, record, profile, raw=True)

    def _follows_this_stream(self, data: bytes) -> bool:
        """Not the state of a twin that still stands where an earlier bridge's stream ended: its numbers mean other events."""
        state = deserialize_message(data, TwinState)
        return self._times.has(state.last_seq, state.robot_time_ns)

    def _publish(self, to: tuple[Publisher, str, str], message: Any) -> None:
        """Serialise once, record, publish."""
        publisher, topic, type_name = to
        data = wire_bytes(message)
        if self._log is not None:
            self._log.write(topic, type_name, data, self.get_clock().now().nanoseconds)
        publisher.publish(data)

    def _tell_state(self, snapshot: Snapshot) -> None:
        bag = str(self._log.path) if self._log is not None and self._log.path is not None and not self._log.fault else ""
        self._publish(self._state, bridge_messages.bridge_state(snapshot, bag, self.get_clock().now().to_msg()))

    def _publish_state(self) -> None:
        if self._bridge is not None:
            self._tell_state(self._bridge.snapshot())
        else:
            self._publish(self._state, bridge_messages.no_bridge_state(self._hint, self.get_clock().now().to_msg()))

    def _each_second(self) -> None:
        if self._settings.autostart and self._bridge is None and self._hinted:
            failure = self._autostart()
            if failure is not None:
                self.get_logger().fatal(str(failure))
                self._end(1)
        self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        told = self._log
        log = None if told is None else LogFacts(str(told.path), told.messages, told.most_waiting, told.fault)
        snapshot = None if self._bridge is None else self._bridge.snapshot()
        stamp = self.get_clock().now().to_msg()
        self._publish(
            self._diagnostics,
            bridge_messages.diagnostics(self.get_name(), snapshot, log, self._observer_there, self._hint, stamp),
        )


def _session_files(p: BridgeParameters) -> tuple[dict[str, bytes], dict[str, str]]:
    """Files that go into the bag, and their hashes. Raises SimError, OSError."""
    library = Path(p.library) if Path(p.library).suffix == ".yaml" else libraries_folder() / f"{p.library}.yaml"
    facts = {
        "library": load_library(p.library).hash,
        "prototype": load_prototype(p.prototype_file or None).hash,
    }
    files = {
        "library.yaml": library.read_bytes(),
        "prototype.yaml": (Path(p.prototype_file) if p.prototype_file else default_path()).read_bytes(),
        "calibration.yaml": _calibration_bytes(p.calibration),
    }
    return files, facts


def _calibration_bytes(path: str) -> bytes:
    from importlib.resources import files

    default = files("hardware_bridge") / "data" / "calibration_default.yaml"
    return Path(path).read_bytes() if path else default.read_bytes()


def _type_name(kind: Any) -> str:
    package = kind.__module__.split(".")[0]
    return f"{package}/msg/{kind.__name__}"


def main(args: list[str] | None = None) -> int:
    """The executable `hardware_bridge`."""
    return run(HardwareBridgeNode, args)


if __name__ == "__main__":
    sys.exit(main())
