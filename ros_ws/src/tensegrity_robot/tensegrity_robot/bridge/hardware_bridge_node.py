# SPDX-License-Identifier: Apache-2.0
"""The hardware bridge's node: a lifecycle node around a bridge, with the session's bag.

Port and frame timer are in a process of their own, and so is the service `stop` (`port_process`): however long a message takes
to be read here, frames go out in time. One executor thread takes calls; observer and disk have threads of their own.
"""

import sys
import threading
import traceback
from pathlib import Path

import numpy as np
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.driver.events import FaceEvent, SentEvent, Snapshot
from hardware_bridge.driver.remote_bridge import HostProcess, RemoteBridge
from hardware_bridge.errors import BridgeError, PortMissing, Refused
from hardware_bridge.prototype_client.handshake import default_link, examine, require_prototype
from hardware_bridge.recording.log_watch import LogWatch
from hardware_bridge.recording.session_bag import SessionLog, bag_folder, mend_journals
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.errors import SimError
from sim_core.structure.urdf import BASE
from tensegrity_interfaces.msg import TwinState
from tensegrity_robot.bridge import bridge_messages
from tensegrity_robot.bridge.bridge_diagnostics import parts_of
from tensegrity_robot.bridge.bridge_parameters import BridgeParameters, rules_of
from tensegrity_robot.bridge.motion_action import MotionServer
from tensegrity_robot.bridge.observer import Observing
from tensegrity_robot.bridge.other_bridges import OtherBridges
from tensegrity_robot.bridge.port_process import COMMAND, StopService
from tensegrity_robot.bridge.preconditions import MotionConditions
from tensegrity_robot.bridge.recorded_topics import RecordedTopics
from tensegrity_robot.bridge.services import BridgeCalls
from tensegrity_robot.bridge.session_facts import session_files
from tensegrity_robot.bridge.shape_judge import ShapeRule
from tensegrity_robot.ros import conversions
from tensegrity_robot.ros.diagnostics import STALE, Part, diagnostics
from tensegrity_robot.ros.errors import StartError
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters
from tensegrity_robot.ros.node_process import STEADY, EndProcess, run
from tensegrity_robot.ros.topics import BRIDGE_FACE, BRIDGE_JOINT_STATES, BRIDGE_STATE, DIAGNOSTICS, FRAMES, STRUTS_SENT, TWIN_STATE

FEEDBACK_PERIOD_S = 0.1
STATE_PERIOD_S = 0.5
NO_PROTOTYPE = "no virtual prototype is running: start one with `ros2 run tensegrity_robot virtual_prototype{}`, or give a port"

SET_ON_THE_BOARD = (
    "what cannot be set from here, and must be set in Pololu's Control Center: home of the six channels on Ignore, speed and "
    "acceleration 0, serial time-out {:g} s"
)

NAMELESS = (
    "the calibration names no robot: where its struts are and how long they ran is forgotten at each start, and counts as unknown "
    'and spent; add a line such as robot: "blue one" to {}'
)


class HardwareBridgeNode(LifecycleNode):
    """See the module."""

    def __init__(self, end: EndProcess):
        self._host = HostProcess(COMMAND, self._on_host_end)
        try:
            self._make(end)
        except BaseException:
            self._host.close()
            raise

    def _make(self, end: EndProcess) -> None:
        super().__init__("hardware_bridge")
        self._end = end
        self._settings = p = declare_parameters(self, BridgeParameters)
        name, stop = self.get_name(), self.resolve_service_name("stop")
        self._host.tell(tuple(StopService(f"{name}_stop", self.get_namespace(), stop, tuple(sys.argv[1:]))))
        self._bridge: RemoteBridge | None = None
        self._link = default_link(self.get_namespace())
        self._session = ""
        self._conditions: MotionConditions | None = None
        self._shape_rule: ShapeRule | None = None
        self._active = False
        self._failure: BridgeError | None = None
        self._latched = ""
        self._rested_s = p.rested_s
        self._hint = f"unconfigured: ros2 lifecycle set {self.get_fully_qualified_name()} configure"
        self._hinted = False
        base = conversions.cdr_string(conversions.frame_prefix(self) + BASE)
        self._topics = RecordedTopics(self, {TWIN_STATE.name: self._follows_this_stream, FRAMES.name: lambda data: base in data})
        self._others = OtherBridges(self)
        self._frame = conversions.frame_prefix(self) + p.frame
        self._observing = Observing(self, self._topics, self._frame, p.stall_limit_m)
        self._motions = MotionServer(self, self._topics)
        self._calls = BridgeCalls(self, self._topics)
        self.create_timer(FEEDBACK_PERIOD_S, self._motions.attend, clock=STEADY)
        self.create_timer(STATE_PERIOD_S, self._publish_state, clock=STEADY)
        self.create_timer(1.0, self._each_second, clock=STEADY)
        if p.autostart:
            failure = self._autostart()
            if failure is not None:
                self.close()
                raise StartError(str(failure)) from failure

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

    def _on_host_end(self, how: str) -> None:
        self.get_logger().fatal(f"the process with the port has ended ({how}): start the bridge again")
        self._end(1)

    def close(self) -> None:
        """Ends threads and closes the bag."""
        self._close_bridge()
        self._host.close()
        self._motions.destroy()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Opens port and bag. Nothing moves."""
        try:
            self._open_bridge()
        except Exception as error:  # also what nobody thought of: rclpy would swallow it without a word
            if not isinstance(error, BridgeError | SimError | OSError):
                self.get_logger().error(traceback.format_exc())
            self._failure = error if isinstance(error, BridgeError) else BridgeError(str(error) or repr(error))
            self._close_bridge()
            if not self._settings.autostart:
                self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._failure = None
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Commands are taken from now on; the supervisor stays DISARMED. Not beside another bridge of the same name."""
        if other := self._others.listen():
            self._failure = Refused(other)
            if not self._settings.autostart:
                self.get_logger().error(other)
            return TransitionCallbackReturn.FAILURE
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ends any motion, struts held, and takes the lease back."""
        self._active = False
        self._calls.let_go()
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
        handshake, doubt = (None, "") if self._settings.port else examine(str(self._link))
        if not self._settings.port and handshake is None:
            self._hint = NO_PROTOTYPE.format("" if self._link == default_link() else f" --link {self._link}")
            self._hint += f" (what lies at {self._link} is not taken for one: {doubt})" if doubt else ""
            if not self._hinted:
                self._hinted = True
                self.get_logger().warning(self._hint)
            return None
        if other := self._others.listen():
            return Refused(other)
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self._hinted = False  # from now on its life is the operator's
            if self.trigger_activate() == TransitionCallbackReturn.SUCCESS:
                return None
        ended_meanwhile = isinstance(self._failure, PortMissing) and not self._settings.port
        return None if ended_meanwhile else self._failure

    def _open_bridge(self) -> None:
        p = self._settings
        if self.get_parameter("use_sim_time").value:
            raise BridgeError(
                "use_sim_time is true: a robot, its goals and its bag go by the computer's clock; leave it false here"
            )
        port = p.port or str(self._link)
        if not p.port:
            require_prototype(self._link)
        if self._shape_rule is None:
            self._shape_rule = ShapeRule(p.prototype_file, p.slack_limit)
        rules = rules_of(p, self._shape_rule)
        attachments, facts = session_files(p) if p.record else ({}, {})
        self._topics.log = SessionLog(self._on_log_fault) if p.record else None
        self._bridge = None
        bridge = self._host.open(
            port,
            rules,
            board=parse_board(p.board),
            baud=p.baud or None,
            time_scale=p.time_scale or None,
            state_dir=Path(p.state_folder) if p.state_folder else None,
            rested_s=self._rested_s,
            silent_board=p.silent_board,
            on_sent=self._on_bridge_sent,
            on_face=self._on_bridge_face,
            on_state=self._on_bridge_state,
        )
        self._bridge = bridge
        self._rested_s = 0.0  # was said of the first opening
        if self._latched:  # only reset leaves a fault, not another opening of the port
            bridge.stop(self._latched)
        snapshot = bridge.snapshot()
        self._session = snapshot.session
        self._others.own(snapshot.session)
        kind = "the virtual prototype" if snapshot.virtual_port else "a real port"
        watch = None
        if self._topics.log is not None:
            facts |= {"port": port, "kind": kind, "board": bridge.board.spec}
            facts |= {"time_scale": f"{snapshot.time_scale:g}", "calibration": rules.calibration.hash}
            facts |= {"robot": snapshot.robot}
            self._topics.log.open(bag_folder(p.bag_folder), self._topics.types, attachments, facts)
            watch = LogWatch(self._topics.log, p.space_limit_mb)
            threading.Thread(target=self._mend_journals, name="mend", daemon=True).start()
        self._conditions = MotionConditions(bridge, self._observing, watch, facts.get("library", ""))
        self._observing.begin(bridge, p.observer)
        bag = f", recording {self._topics.log.path}" if self._topics.log else ", not recording"
        named = "" if snapshot.virtual_port else f"robot {snapshot.robot!r}, " if snapshot.robot else "a robot without a name, "
        self.get_logger().info(
            f"{kind} at {port}, {named}calibration {rules.calibration.hash[:12]}, board {bridge.board.spec}, "
            f"time scale {snapshot.time_scale:g}{bag}; DISARMED, nothing moves"
        )
        if not (snapshot.virtual_port or snapshot.robot):
            self.get_logger().warning(NAMELESS.format(p.calibration or "its own calibration"))
        if bridge.board_timeout_s is not None and not snapshot.virtual_port:
            self.get_logger().info(SET_ON_THE_BOARD.format(bridge.board_timeout_s))
        self._tell_state(snapshot)  # with its bag
        self._publish_diagnostics()

    def _close_bridge(self) -> None:
        bridge, self._bridge, self._conditions = self._bridge, None, None
        log, self._topics.log = self._topics.log, None
        try:
            if bridge is not None:
                self._topics.log = log  # its last events
                bridge.close()
        except BridgeError as error:
            self.get_logger().error(str(error))
        finally:
            if bridge is not None:
                last = bridge.snapshot()
                self._latched = last.reason if last.mode is Mode.FAULT else ""
            self._topics.log = None
        self._observing.end()
        if log is not None:
            try:
                log.close()
            except BridgeError as error:
                self.get_logger().error(str(error))
        self._motions.finish()

    # ---- what the bridge tells, from its own threads, in order --------------------------------------------------------

    def _on_bridge_sent(self, event: SentEvent) -> None:
        header = Header(stamp=conversions.stamp_of(event.wall_ns), frame_id=self._frame)
        self._topics.publish(STRUTS_SENT, bridge_messages.struts_sent(event, header))
        lengths_m = np.where(event.known, event.lengths_m, np.nan)
        self._topics.publish(BRIDGE_JOINT_STATES, conversions.joint_states(header.stamp, lengths_m))
        self._observing.heard(event)

    def _on_bridge_face(self, event: FaceEvent) -> None:
        header = Header(stamp=conversions.stamp_of(event.wall_ns), frame_id=self._frame)
        self._topics.publish(BRIDGE_FACE, bridge_messages.face_observation(event, header))

    def _on_bridge_state(self, snapshot: Snapshot) -> None:
        self._tell_state(snapshot)
        if self.executor is not None:
            self.executor.create_task(self._motions.attend)

    def _on_log_fault(self, problem: str) -> None:
        self.get_logger().error(f"the log is dead: {problem}")
        if self.executor is not None:
            self.executor.create_task(self._attend_log)

    # ---- for its calls ----------------------------------------------------------------------------------------------

    def bridge(self) -> RemoteBridge:
        """The open bridge. Raises Refused."""
        if self._bridge is None:
            raise Refused(self._hint)
        return self._bridge

    def ready(self) -> RemoteBridge:
        """The bridge, if commands are taken. Raises Refused."""
        bridge = self.bridge()
        if not self._active:
            raise Refused(f"the bridge is inactive: ros2 lifecycle set {self.get_fully_qualified_name()} activate")
        return bridge

    def confirmed_lengths_m(self) -> list[float | None] | None:
        """What an observer sees of struts of unknown length. Raises Refused: this robot must not be armed now."""
        snapshot, conditions = self.bridge().snapshot(), self._conditions
        if other := self._others.found():
            raise Refused(other)
        assert conditions is not None
        conditions.require_armable()
        return self._observing.unknown_lengths_m(snapshot)

    def permit(self, trajectory: Trajectory, library_hash: str) -> None:
        """Raises Refused: this motion must not begin now, and why."""
        self.ready()
        if self._conditions is not None:
            self._conditions.require_movable(trajectory, library_hash)

    # ---- publishing -------------------------------------------------------------------------------------------------

    def _follows_this_stream(self, data: bytes) -> bool:
        """Not the state of a twin that still stands where another bridge's stream ended: its numbers mean other events."""
        return bool(deserialize_message(data, TwinState).session == self._session)

    def _tell_state(self, snapshot: Snapshot) -> None:
        stamp = self.get_clock().now().to_msg()
        self._topics.publish(BRIDGE_STATE, bridge_messages.bridge_state(snapshot, self._topics.log, stamp))

    def _publish_state(self) -> None:
        if self._bridge is not None:
            self._tell_state(self._bridge.snapshot())
        else:
            self._topics.publish(BRIDGE_STATE, bridge_messages.no_bridge_state(self._hint, self.get_clock().now().to_msg()))

    def _each_second(self) -> None:
        if self._settings.autostart and self._bridge is None and self._hinted:
            failure = self._autostart()
            if failure is not None:
                self.get_logger().fatal(str(failure))
                self._end(1)
        self._yield_to_another()
        self._attend_log()
        self._publish_diagnostics()

    def _yield_to_another(self) -> None:
        """Whoever started while another bridge was there gives way, though it heard it late."""
        bridge = self._bridge
        if bridge is None or not (self._active and self._others.may_be_late) or bridge.snapshot().mode is not Mode.DISARMED:
            return
        if other := self._others.found():
            self._active = False
            self.get_logger().fatal(other)
            self._end(1)

    def _attend_log(self) -> None:
        conditions = self._conditions
        if conditions is not None and (held_for := conditions.attend()):
            self.get_logger().error(f"the motion is held: {held_for}")

    def _publish_diagnostics(self) -> None:
        port, parts = "", [Part("link", STALE, self._hint)]
        if self._bridge is not None:
            snapshot, watch = self._bridge.snapshot(), self._conditions.watch if self._conditions is not None else None
            port, parts = snapshot.port, parts_of(snapshot, self._topics.log, watch, self._topics.dropped, self._observing)
        stamp = self.get_clock().now().to_msg()
        self._topics.publish(DIAGNOSTICS, diagnostics(self.get_fully_qualified_name().lstrip("/"), port, parts, stamp))


ABOUT = About(
    name="hardware_bridge",
    text="sends motions to the servo board within limits, and records all that is sent, heard and seen",
    settings=BridgeParameters,
    gives="bridge/struts_sent bridge/joint_states bridge/face bridge/state /diagnostics bridge/asked bridge/observed_joints "
    "bridge/trial execute_struts() bridge/arm() bridge/disarm() stop() reset() set_face() log_trial()",
    takes="bridge/state bridge/lease",
    example="-p port:=/dev/rfcomm0 -p calibration:=/path/to/blue.yaml",
)


def main() -> int:
    """The executable `hardware_bridge`."""
    return run(HardwareBridgeNode, ABOUT)
