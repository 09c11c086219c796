# SPDX-License-Identifier: Apache-2.0
"""The twin: a model that follows what really happened to the robot, or, stand-alone, is the robot.

Events come through the executor; what is published at a rate comes from a loop with absolute deadlines on the steady clock, in a
thread of its own: an executor's timer at 200 Hz costs more than twice as much and is less even. One lock lets only one of them
at the model.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory

from hardware_bridge.driver.frame_timer import Streamer
from sim_core.dynamics.actuators import following, require_actuators
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.errors import DivergedError
from sim_core.rolling.warm_up import Stage, is_warm, warm_up
from sim_core.sensing.mounting import load_mounting
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import require_face
from sim_core.structure.urdf import urdf
from sim_core.twin.event_stream import Arrival, Begin, EventStream
from sim_core.twin.follower import RULE, Event, Follower, Observed
from sim_core.twin.rest_detector import RestWatch
from sim_core.twin.standalone import StandAlone
from sim_core.uncertainty.perturbation_law import MAX_SCALE, perturb
from tensegrity_interfaces.msg import FaceObservation, StrutsSent, TwinState
from tensegrity_robot.ros import conversions, topics
from tensegrity_robot.ros.errors import StartError
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters, parameter
from tensegrity_robot.ros.node_process import EndProcess, age_s, run
from tensegrity_robot.twin.markers import markers

CATCH_UP_S = 0.02
"""Wall time that one callback may spend on stepping the model; a deadline's turn at most half a period."""

MOST_DUE = 50_000
"""Events that may wait to be stepped."""

BEGIN_WAIT_S = 1.0
"""A stream begins this long after its first write was heard; the faces that somebody saw before arrive sooner."""

FRAMES_HZ = 50.0
"""Most that /tf is published a second."""

TENDON_FULL_SCALE = 2.5
"""Tension drawn in full red, in tensions of the ideal shape."""


@dataclass(frozen=True)
class TwinParameters:
    """Parameters of the twin; the descriptions are what `ros2 param describe` shows."""

    mode: str = parameter("follow", "shadow the bridge's event stream, or be the robot", choices=("follow", "standalone"))
    start_face: str = parameter("TC6", "face it stands on until somebody saw the robot: TC1..TC8 or TO1..TO12")
    prototype_file: str = parameter("", "YAML of the robot's numbers; empty: the nominal prototype")
    perturbation: float = parameter(0.0, "scale of random errors of the model, 0.1 for ±10 %", low=0.0, high=MAX_SCALE)
    seed: int = parameter(0, "seed of the random errors", low=0, high=2**31 - 1)
    actuators: str = parameter("ideal", "following: its actuators: ideal, stand-in (they feel their load), or a YAML file")
    rate_hz: float = parameter(20.0, "how often state and joints are published [Hz]", low=1.0, high=200.0)
    markers_hz: float = parameter(10.0, "how often markers are published [Hz]; 0: never", low=0.0, high=20.0)
    mounting: str = parameter("", "YAML of how an inertial sensor sits in the box, for imu_link; empty: its axes are the box's")
    frame: str = parameter("odom", "frame of all poses; below a namespace its name gets that prefix: robot1/odom")
    time_scale: float = parameter(1.0, "stand-alone: robot seconds per second", low=0.01, high=50.0)


class _Shown(NamedTuple):
    """The model's present state as messages."""

    state: TwinState
    joint_states: JointState
    joints: PoseArray
    pose: PoseStamped


class TwinNode(Node):
    """See the module."""

    def __init__(self, end: EndProcess):
        super().__init__("twin")
        self._settings = p = declare_parameters(self, TwinParameters)
        require_face(p.start_face)
        prototype = load_prototype(p.prototype_file or None)
        self._actuators = require_actuators(p.actuators)
        if self._actuators is not None:
            if p.mode == "standalone":
                raise StartError(f"actuators {p.actuators!r}: a stand-alone twin has ideal ones only")
            prototype = following(prototype, self._actuators)
        if not is_warm():
            self.get_logger().info("compiling the solver, once for these sources: some seconds")
            warm_up([Stage.ROBOT])
        self._model = perturb(build_model(prototype), p.perturbation, p.seed)
        self._alone = StandAlone(self._model, p.start_face, p.time_scale) if p.mode == "standalone" else None
        self._follow_from(p.start_face)
        self._stream = EventStream(mid_stroke_m=prototype.strut_length_m, warn=self.get_logger().warning)
        self._due: deque[Event | Begin] = deque()
        self._dropped = 0
        self._waiting_since: float | None = None
        self._at_rest = False
        self._told_face: tuple[str, bool] | None = None
        self._turn = threading.Lock()
        """Whoever steps the model, or shows it, holds it."""
        self._shown: _Shown | None = None
        self._told_start = False
        self._prefix = conversions.frame_prefix(self)
        self._frames_due_s = 0.0
        self._full_scale_n = TENDON_FULL_SCALE * float(Robot(self._model).cable_forces_n()[:24].mean())

        self._state = topics.TWIN_STATE.publisher(self)
        self._face = topics.TWIN_FACE.publisher(self)
        self._joint_states = topics.TWIN_JOINT_STATES.publisher(self)
        self._joints = topics.TWIN_JOINTS.publisher(self)
        self._pose = topics.TWIN_POSE.publisher(self)
        self._markers = topics.TWIN_MARKERS.publisher(self)
        self._frames = topics.FRAMES.publisher(self)
        self._description = topics.ROBOT_DESCRIPTION.publisher(self)
        self._mounting = load_mounting(p.mounting) if p.mounting else np.eye(3)
        self._urdf = String(data=urdf(prototype, self._prefix, self._mounting))
        self._description.publish(self._urdf)
        if self._alone is None:
            found = SubscriptionEventCallbacks(matched=self._on_bridge_found)
            topics.STRUTS_SENT.subscribe(self, self._on_sent, event_callbacks=found)
            topics.BRIDGE_FACE.subscribe(self, self._on_face)
        else:
            topics.TWIN_COMMAND.subscribe(self, self._on_command)
        if p.markers_hz > 0.0:
            self.create_timer(1.0 / p.markers_hz, self._publish_markers)
        self.get_logger().info(f"twin ({p.mode}) stands on {p.start_face}, model {self._follower.identity}")
        self._deadlines = Streamer(self._on_deadline, lambda _error: end(1), 1.0 / p.rate_hz, "twin states")
        self._deadlines.start()

    # ---- process ----------------------------------------------------------------------------------------------------

    def halt(self) -> None:
        """Publishes nothing more."""
        self._deadlines.stop()

    def close(self) -> None:
        """Nothing to let go of."""

    # ---- following --------------------------------------------------------------------------------------------------

    def _on_bridge_found(self, change: QoSSubscriptionMatchedInfo) -> None:
        if change.current_count_change > 0 and change.current_count == 1:  # beside another, it may be a recording that is played
            with self._turn:
                self._stream.renew()

    def _on_sent(self, message: StrutsSent) -> None:
        with self._turn:
            self._take(self._stream.sent(conversions.sent_event(message), _arrival(message)))

    def _on_face(self, message: FaceObservation) -> None:
        with self._turn:
            self._take(self._stream.observed(conversions.observed_event(message), _arrival(message)))

    def _take(self, due: list[Event | Begin]) -> None:
        self._due.extend(due)
        while len(self._due) > MOST_DUE:  # nobody steps so much later on: go on from the newest, as after a pause
            first = self._due.popleft()
            if isinstance(first, Begin) and not isinstance(self._due[0], Begin):
                self._due[0] = first
            self._dropped += 1
        self._catch_up(CATCH_UP_S)

    def _catch_up(self, most_s: float) -> None:
        """Apply events that are due; what there is no time for waits for the next callback or deadline."""
        self._begin_in_time()
        until = time.monotonic() + most_s
        while self._due and time.monotonic() < until:
            event = self._due[0]
            self._shown = None
            try:
                if not isinstance(event, Begin) and not self._follower.approach(event):
                    continue  # a long pause: in slices, so that nobody waits for it
                self._due.popleft()
                if isinstance(event, Begin):
                    self._begin(event)
                    continue
                self._follower.apply(event)
            except DivergedError as error:
                self._begin_again(error)
                continue
            self._at_rest = self._rest.at_rest(self._follower.robot, self._follower.step)
            if isinstance(event, Observed) and event.settled:
                self._state.publish(self._show().state)
            self._tell_face()

    def _begin_in_time(self) -> None:
        if not self._stream.waiting:
            self._waiting_since = None
        elif self._waiting_since is None:
            self._waiting_since = time.monotonic()
        elif time.monotonic() - self._waiting_since > BEGIN_WAIT_S:
            self._due.extend(self._stream.begin())

    def _begin(self, begin: Begin) -> None:
        """A new stream: begin where the robot was last seen, else where the twin believes it to stand."""
        self._follow_from(begin.face or self._follower.robot.footing().face or self._settings.start_face)
        self._description.publish(self._urdf)  # once more, for the bag of the session that begins
        self.get_logger().info(f"the event stream begins; the twin stands on {self._began_on}")

    def _begin_again(self, error: DivergedError) -> None:
        """Commands that tear the model apart end no twin."""
        self.get_logger().error(f"{error}: the twin begins again, at rest on {self._began_on}")
        self._follow_from(self._began_on)

    def _follow_from(self, face: str) -> None:
        self._began_on = face
        self._follower = Follower(self._model, face, self._actuators)
        self._rest = RestWatch()

    # ---- stand-alone ------------------------------------------------------------------------------------------------

    def _on_command(self, message: JointTrajectory) -> None:
        assert self._alone is not None
        lengths = message.points[-1].positions if message.points else []
        with self._turn:
            refusal = self._alone.command(message.joint_names, lengths)
        if refusal:
            self.get_logger().warning(f"twin/command refused: {refusal}")

    # ---- publishing -------------------------------------------------------------------------------------------------

    @property
    def _now(self) -> Follower | StandAlone:
        return self._alone or self._follower

    @property
    def _robot(self) -> Robot:
        return self._now.robot

    def _header(self) -> Header:
        return Header(stamp=self.get_clock().now().to_msg(), frame_id=self._prefix + self._settings.frame)

    def _on_deadline(self, _missed: int) -> None:
        with self._turn:
            if self._alone is None:
                self._catch_up(min(CATCH_UP_S, 0.5 / self._settings.rate_hz))
            else:
                self._alone.run_until(time.monotonic_ns())
                self._at_rest = self._rest.at_rest(self._alone.robot, self._alone.robot.step)
                self._shown = None
            shown = self._show()
            self._state.publish(shown.state)
            self._tell_face()
            self._joint_states.publish(shown.joint_states)
            self._joints.publish(shown.joints)
            self._pose.publish(shown.pose)
            if time.monotonic() >= self._frames_due_s:
                self._frames_due_s = time.monotonic() + 1.0 / FRAMES_HZ
                self._frames.publish(conversions.frames(self._robot, shown.pose, self._prefix, self._mounting))
        if not self._told_start:
            self._told_start = True
            self.get_logger().info(f"first state published {age_s():.2f} s after the process began")

    def _show(self) -> _Shown:
        """The model as messages, stamped now; made anew only after a change, seldom at a high rate."""
        if self._shown is None:
            robot, header = self._robot, self._header()
            speeds = conversions.strut_speeds_m_s(robot)
            self._shown = _Shown(
                self._state_message(header),
                conversions.joint_states(header.stamp, robot.rest_lengths_m(), speeds, robot.strut_forces_n()),
                conversions.joints(robot, header),
                conversions.body_pose(robot, header),
            )
        else:
            stamp = self.get_clock().now().to_msg()
            for message in self._shown:
                message.header.stamp = stamp
        return self._shown

    def _state_message(self, header: Header) -> TwinState:
        message = conversions.twin_state(self._robot, header)
        message.robot_time_ns = self._now.robot_time_ns
        message.face = (self._robot.footing().face if self._at_rest else self._robot.face_under()) or ""
        message.at_rest = self._at_rest
        if self._alone is None:
            follower = self._follower
            message.model_hash = follower.identity
            message.session, message.rule = self._stream.session, RULE
            message.step, message.first_seq, message.last_seq = follower.step, follower.first_seq, follower.last_seq
            message.detail = self._detail(follower.resets)
        else:
            message.step = self._robot.step
            message.detail = f"stand-alone, {self._alone.skipped_s:.3f} s skipped"
        return message

    def _detail(self, resets: int) -> str:
        stream = self._stream
        text = f"began on {self._began_on}, {stream.lost + self._dropped} events lost, {resets} corrections by observation"
        counts = ((stream.refused, "impossible events refused"), (stream.strangers, "events of other sessions ignored"))
        return ", ".join([text, *(f"{count} {what}" for count, what in counts if count)])

    def _tell_face(self) -> None:
        """Publish the face if it, or whether the robot rests on it, has changed."""
        footing = self._robot.footing()
        now = (footing.face or "", self._at_rest)
        if now == self._told_face:
            return
        self._told_face = now
        self._face.publish(
            FaceObservation(
                header=self._header(),
                robot_time_ns=self._now.robot_time_ns,
                face=now[0],
                source=FaceObservation.SOURCE_PREDICTED,
                settled=self._at_rest,
                detail=footing.detail,
            )
        )

    def _publish_markers(self) -> None:
        with self._turn:
            robot = self._robot.copy()
        self._markers.publish(markers(robot, robot.footing().face or "", self._header(), self._full_scale_n))


def _arrival(message: StrutsSent | FaceObservation) -> Arrival:
    steady_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)  # it goes on while a laptop sleeps, as the robot does
    return Arrival(message.session, conversions.nanoseconds(message.header.stamp), time.time_ns(), steady_ns)


ABOUT = About(
    name="twin",
    text="a model that follows what really happened to the robot, or, stand-alone, is the robot",
    settings=TwinParameters,
    gives="twin/state twin/face twin/joint_states twin/joints twin/pose twin/markers /tf robot_description",
    takes="bridge/struts_sent bridge/face twin/command",
    example="-p start_face:=TO5",
)


def main() -> int:
    """The executable `twin`."""
    return run(TwinNode, ABOUT)
