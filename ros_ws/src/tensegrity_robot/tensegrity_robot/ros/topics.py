# SPDX-License-Identifier: Apache-2.0
"""The one table of the stack's topics: publishers, subscriptions, recorder, player and the reference are made from it."""

from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from tensegrity_interfaces.msg import (
    BridgeState,
    FaceEstimate,
    FaceObservation,
    LeaseProof,
    Rehearsal,
    StrutsSent,
    TrialRecord,
    TwinState,
)
from tensegrity_robot.ros import qos


class Topic(NamedTuple):
    """A topic.

    Attributes:
        name: relative, but for those that all of ROS shares. kind: class of its messages. profile: quality of service.
        told_by: "bridge": published and recorded by the bridge, and played again from a bag, but for /diagnostics; "others":
            recorded by the bridge as far as its quota goes; "": not recorded.
        about: what it tells, for the reference.
    """

    name: str
    kind: Any
    profile: QoSProfile
    told_by: str
    about: str

    @property
    def type_name(self) -> str:
        """Its messages' type, such as `sensor_msgs/msg/JointState`."""
        return f"{self.kind.__module__.split('.')[0]}/msg/{self.kind.__name__}"

    @property
    def latched(self) -> bool:
        """Whether late joiners are told the newest."""
        return self.profile in (qos.FACES, qos.LATCHED)

    def publisher(self, node: Node, profile: QoSProfile | None = None) -> Publisher:
        """A publisher of a node. Args: profile: another than the topic's own."""
        return node.create_publisher(self.kind, self.name, profile or self.profile)

    def subscribe(self, node: Node, callback: Callable[..., None], profile: QoSProfile | None = None, **more: Any) -> Any:
        """A subscription of a node. Args: profile: another than the topic's own. more: as in `create_subscription`."""
        return node.create_subscription(self.kind, self.name, callback, profile or self.profile, **more)


ASKED = Topic("bridge/asked", JointTrajectory, qos.STATES, "bridge", "each accepted motion, as asked")
STRUTS_SENT = Topic("bridge/struts_sent", StrutsSent, qos.STREAM, "bridge", "what the board was really sent")
BRIDGE_FACE = Topic("bridge/face", FaceObservation, qos.FACES, "bridge", "what somebody saw, with its source")
BRIDGE_STATE = Topic("bridge/state", BridgeState, qos.LATCHED, "bridge", "the bridge's state: on every change, and at 2 Hz")
BRIDGE_JOINT_STATES = Topic("bridge/joint_states", JointState, qos.STATES, "bridge", "commanded, never measured; NaN: not known")
OBSERVED_JOINTS = Topic("bridge/observed_joints", PoseArray, qos.STATES, "bridge", "joints and box, as an observer saw them")
TRIAL = Topic("bridge/trial", TrialRecord, qos.FACES, "bridge", "trials, as logged")
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, qos.STATES, "bridge", "the bridge's health, at 1 Hz")

LEASE = Topic("bridge/lease", LeaseProof, qos.STATES, "", "proof of life of the lease's holder, at 2 Hz or more")
REHEARSAL = Topic("rehearsal", Rehearsal, qos.LATCHED, "others", "how the next roll went on the planner's ensemble")
TWIN_STATE = Topic("twin/state", TwinState, qos.STATES, "others", "the twin's step, face, forces and digest")
TWIN_FACE = Topic("twin/face", FaceObservation, qos.FACES, "others", "the face that the twin predicts")
TWIN_JOINT_STATES = Topic("twin/joint_states", JointState, qos.STATES, "others", "length (m), speed (m/s), axial force (N)")
TWIN_JOINTS = Topic("twin/joints", PoseArray, qos.STATES, "", "twelve joints, then the box")
TWIN_POSE = Topic("twin/pose", PoseStamped, qos.STATES, "others", "body pose: centre of the nodes, best-fit rotation")
TWIN_MARKERS = Topic("twin/markers", MarkerArray, qos.STATES, "others", "the robot for viewers, also of a bag; at most 20 Hz")
FRAMES = Topic(
    "/tf", TFMessage, qos.STATES, "others", "the twin's frames, below a namespace as `NAMESPACE/base_link`; at most 50 Hz"
)
ROBOT_DESCRIPTION = Topic("robot_description", String, qos.LATCHED, "others", "the robot's URDF, whose links are the frames of /tf")
TWIN_COMMAND = Topic("twin/command", JointTrajectory, qos.STATES, "", "rest lengths for a stand-alone twin")
IMU_DATA = Topic(
    "imu/data", Imu, qos.SENSORS, "others", "an inertial sensor in the box, in its own axes; whose driver does not matter"
)
FACE_ESTIMATE = Topic("face_estimate", FaceEstimate, qos.STATES, "others", "what that sensor tells about the face, sure or not")
GOAL_POSE = Topic("goal_pose", PoseStamped, qos.STATES, "others", "where to travel; replaces the travel under way")
KEEP_IN = Topic(
    "keep_in", PolygonStamped, qos.LATCHED, "others", "the area that chains and travels stay in; no points: none is set"
)
TRAVEL_GOAL = Topic("travel/goal", PoseStamped, qos.LATCHED, "others", "where the travel under way goes")
TRAVEL_PATH = Topic("travel/path", Path, qos.LATCHED, "others", "the way planned now")
TRIAL_PANEL = Topic("trial/panel", String, qos.LATCHED, "", "a session that a person judges, to the console")
TRIAL_KEY = Topic("trial/key", String, qos.STATES, "", "a key, from the console")

TOPICS = tuple(value for value in list(globals().values()) if isinstance(value, Topic))
"""All of them."""
