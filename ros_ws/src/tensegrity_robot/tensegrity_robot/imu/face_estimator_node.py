# SPDX-License-Identifier: Apache-2.0
"""Which face the robot stands on, by any inertial sensor in its box that publishes `sensor_msgs/Imu`; told to the bridge.

Measuring and doubting are in `sim_core.sensing`. Here is what a node adds: whose measurements these are, whose struts, whose twin;
and that a recording, a second sensor or another bridge mislead nobody.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, Vector3
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from sim_core.dynamics.model import build_model
from sim_core.sensing.face_filter import box_share
from sim_core.sensing.face_watch import FaceWatch, Word
from sim_core.sensing.mounting import load_mounting
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import load_prototype
from sim_core.structure.rotations import quaternion_of
from sim_core.twin.live_bridge import LiveBridge, age_s, is_fresh
from tensegrity_interfaces.msg import BridgeState, FaceEstimate, FaceObservation, StrutsSent
from tensegrity_interfaces.srv import SetFace
from tensegrity_robot.ros import conversions, qos, topics
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters, parameter
from tensegrity_robot.ros.node_process import STEADY, EndProcess, run

PERIOD_S = 0.1
TWIN_LIMIT_S = 5.0
"""A twin that is not heard for so long, wall time, is missed."""
MISSED_S, MOST_SILENT_TICKS = 0.5, 3
"""A sensor that is not heard for so long, wall time, is missed."""
ANSWER_LIMIT_S = 5.0
"""Wall time after which a bridge that does not answer is asked again."""
OTHERS_PERIOD_S = 1.0
"""Between looks for other sensors."""


@dataclass(frozen=True)
class EstimatorParameters:
    """Parameters of the estimator; the descriptions are what `ros2 param describe` shows."""

    mounting: str = parameter("", "YAML of how the sensor sits, from `sixstrut calibrate imu`; empty: its axes are the box's")
    prototype_file: str = parameter("", "YAML of the robot's numbers; empty: the nominal prototype")


class FaceEstimatorNode(Node):
    """See the module. Everything runs in one executor thread."""

    def __init__(self, _end: EndProcess):
        super().__init__("face_estimator")
        p = declare_parameters(self, EstimatorParameters)
        self._rotation = load_mounting(p.mounting) if p.mounting else np.eye(3)
        self._watch = FaceWatch(box_share(build_model(load_prototype(p.prototype_file or None))))
        self._scale = 1.0
        self._began_ns = self.get_clock().now().nanoseconds
        self._shaped_s = time.monotonic()
        self._looked_s = self._heard_s = self._asked_s = 0.0
        self._silent_ticks = 0
        self._pending: Word | None = None
        self._asked: Word | None = None
        self._spoke = False
        self._several = 0
        self._newest = Header()
        self._live = LiveBridge(self.get_logger().warning, self._on_other_bridge, strange=self._on_stranger)
        self._estimates = topics.FACE_ESTIMATE.publisher(self)
        self._set_face = self.create_client(SetFace, "set_face")
        live = self._live.takes
        topics.BRIDGE_STATE.subscribe(self, self._on_bridge_state)
        topics.STRUTS_SENT.subscribe(self, lambda event: live(event, self._on_sent), qos.STATES)
        topics.BRIDGE_FACE.subscribe(self, lambda event: live(event, self._on_face))
        topics.TWIN_JOINTS.subscribe(self, self._on_joints)
        topics.IMU_DATA.subscribe(self, self._on_measurement)
        self.create_timer(PERIOD_S, self._on_time, clock=STEADY)
        sits = f"mounting {p.mounting}" if p.mounting else "no mounting is given: the sensor's axes are taken for the box's"
        self.get_logger().info(f"measurements on {self.resolve_topic_name(topics.IMU_DATA.name)}; {sits}")

    def halt(self) -> None:
        """Nothing of it moves anything."""

    def close(self) -> None:
        """Nothing to let go of."""

    # ---- what is heard ----------------------------------------------------------------------------------------------

    def _on_bridge_state(self, message: BridgeState) -> None:
        if self._live.hears(message, self.get_clock().now().nanoseconds):
            self._scale = float(message.time_scale) or 1.0

    def _on_other_bridge(self) -> None:
        self._watch.begin_anew()
        self._watch.tell_again()

    def _on_stranger(self, words: str) -> None:
        self._tell(self._watch.distrust(words))

    def _on_sent(self, message: StrutsSent) -> None:
        self._watch.struts(message.length_m, not message.heartbeat)

    def _on_face(self, message: FaceObservation) -> None:
        if message.source == FaceObservation.SOURCE_IMU:
            if not self._spoke:  # an estimator before this one knew better than who spoke before it
                self._watch.said("")
        elif message.settled:
            self._watch.said(message.face)

    def _on_joints(self, message: PoseArray) -> None:
        if len(message.poses) < 13 or not is_fresh(message.header.stamp, self.get_clock().now().nanoseconds):
            return  # of a recording
        self._shaped_s = time.monotonic()
        turn = message.poses[12].orientation
        places = np.array([(pose.position.x, pose.position.y, pose.position.z) for pose in message.poses[:13]])
        self._watch.shape(places[:12], places[12], np.array((turn.w, turn.x, turn.y, turn.z)))

    def _on_measurement(self, message: Imu, info: dict[str, Any]) -> None:
        if not self._live.session:
            return
        stamp, sent_ns = message.header.stamp, int(info["source_timestamp"])  # this process may be late itself
        if not is_fresh(stamp, sent_ns):
            late = f"measurements are sent {age_s(stamp, sent_ns):.0f} s after they were made"
            old = f"{late}: a recording is played, or clocks differ"
            self._tell(self._watch.distrust(old))
            return
        if self._several > 1:
            return
        self._newest, self._heard_s, self._silent_ticks = message.header, time.monotonic(), 0
        rate, acceleration = (self._rotation @ _vector(told) for told in (message.angular_velocity, message.linear_acceleration))
        self._tell(self._watch.measured(self._robot_s(conversions.nanoseconds(stamp)), rate, acceleration))

    def _robot_s(self, stamp_ns: int) -> float:
        """Robot time that has passed since the beginning, if time has gone on as it goes now."""
        return (stamp_ns - self._began_ns) * 1e-9 * self._scale

    # ---- what is told -----------------------------------------------------------------------------------------------

    def _on_time(self) -> None:
        now_s = time.monotonic()
        if now_s - self._looked_s > OTHERS_PERIOD_S:
            self._looked_s = now_s
            self._several = self.count_publishers(self.resolve_topic_name(topics.IMU_DATA.name))
            if self._several > 1:
                self._tell(self._watch.distrust(f"{self._several} sensors publish on {topics.IMU_DATA.name}: end all but one"))
        if self._live.session and now_s - self._shaped_s > TWIN_LIMIT_S:
            self.get_logger().warning("no twin tells its joints: start it, faces cannot be told else", throttle_duration_sec=60.0)
            self._tell(self._watch.unshaped())
        self._silent_ticks += 1  # this process may have been late itself: what waits is heard before the next tick
        if self._silent_ticks > MOST_SILENT_TICKS and now_s - self._heard_s > MISSED_S:
            self._tell(self._watch.missing((now_s - self._heard_s) * self._scale))
        self._send()
        watch = self._watch
        self._estimates.publish(
            FaceEstimate(
                header=self._newest,
                probability=watch.probabilities,
                moving=watch.moving,
                residual_rad=watch.residual_rad,
                face=watch.known,
                ahead_rad=watch.heading.ahead_rad,
                mounting=quaternion_of(self._rotation),
                doubt=watch.doubt,
            )
        )

    def _tell(self, word: Word | None) -> None:
        if word is None:
            return
        if not word.face:
            self.get_logger().warning(f"the face is not known: {word.detail}")
        self._pending = word
        self._send()

    def _send(self) -> None:
        """The newest word to the bridge, until it takes it."""
        word = self._pending
        waits = self._asked is not None and time.monotonic() - self._asked_s < ANSWER_LIMIT_S
        if word is None or waits or not self._set_face.service_is_ready():
            return
        self._asked, self._asked_s, self._spoke = word, time.monotonic(), True
        request = SetFace.Request(face=word.face, source=FaceObservation.SOURCE_IMU, moving=not word.settled, detail=word.detail)
        self._set_face.call_async(request).add_done_callback(self._on_answer)

    def _on_answer(self, future: Future) -> None:
        answer, asked, self._asked = future.result(), self._asked, None
        if not answer.success:
            self.get_logger().warning(f"the bridge does not take the face: {answer.message}", throttle_duration_sec=10.0)
        elif self._pending is asked:
            self._pending = None
        else:
            self._send()


def _vector(told: Vector3) -> Array:
    return np.array((told.x, told.y, told.z))


ABOUT = About(
    name="face_estimator",
    text="tells the bridge which face the robot stands on, by an inertial sensor in its box",
    settings=EstimatorParameters,
    gives="face_estimate",
    takes="imu/data bridge/state bridge/struts_sent bridge/face twin/joints set_face()",
    example="-p mounting:=/path/to/mounting.yaml",
)


def main() -> int:
    """The executable `face_estimator`."""
    return run(FaceEstimatorNode, ABOUT)
