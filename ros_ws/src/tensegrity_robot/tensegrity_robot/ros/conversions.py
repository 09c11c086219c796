# SPDX-License-Identifier: Apache-2.0
"""Values to messages and back."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage

from sim_core.dynamics.robot import Robot
from sim_core.names import STRUT_NAMES
from sim_core.structure.arrays import Array
from sim_core.structure.rotations import matrix_of, quaternion_of, relative_quaternion, rotated
from sim_core.structure.topology import TENDONS
from sim_core.structure.urdf import BASE, BOX, IMU, LINKS
from sim_core.twin.follower import Observed, Sent
from tensegrity_interfaces.msg import FaceObservation, StrutsSent, TwinState


def sent_event(message: StrutsSent) -> Sent:
    """What the twin needs of a write or a heartbeat."""
    return Sent(message.seq, message.robot_time_ns, tuple(float(length) for length in message.length_m))


def observed_event(message: FaceObservation) -> Observed:
    """What the twin needs of a face observation."""
    return Observed(message.seq, message.robot_time_ns, message.face or None, message.settled)


def nanoseconds(stamp: Time) -> int:
    """A stamp as one number."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamp_of(since_1970_ns: int) -> Time:
    """ROS time of the computer's clock."""
    return Time(sec=since_1970_ns // 1_000_000_000, nanosec=since_1970_ns % 1_000_000_000)


def frame_prefix(node: Node) -> str:
    """What begins the names of all frames of a node's robot: its namespace and a slash, or nothing."""
    namespace = str(node.get_namespace()).strip("/")
    return f"{namespace}/" if namespace else ""


def cdr_string(text: str) -> bytes:
    """A string with its length as it lies in an undecoded message: a longer one that ends alike is not taken for it."""
    return bytes(serialize_message(String(data=text))[4:])  # without the header of a whole message


def point(position_m: Array) -> Point:
    """A position, shape (3,)."""
    return Point(x=float(position_m[0]), y=float(position_m[1]), z=float(position_m[2]))


def pose(position_m: Array, quaternion: Array | None = None) -> Pose:
    """A position (3,) and an orientation (w, x, y, z), by default none."""
    if quaternion is None:
        return Pose(position=point(position_m))
    w, x, y, z = (float(value) for value in quaternion)
    return Pose(position=point(position_m), orientation=Quaternion(x=x, y=y, z=z, w=w))


def joints(robot: Robot, header: Header) -> PoseArray:
    """The twelve joints, then the box."""
    places = np.vstack([robot.joints_m(), robot.box_m()])
    poses = [pose(place, turn) for place, turn in zip(places, robot.quaternions(), strict=True)]
    return PoseArray(header=header, poses=poses)


def body_pose(robot: Robot, header: Header) -> PoseStamped:
    """Centre of the joints and their best-fit rotation."""
    center, turn = robot.body_pose()
    return PoseStamped(header=header, pose=pose(center, quaternion_of(turn)))


def frames(robot: Robot, body: PoseStamped, prefix: str, mounting: Array) -> TFMessage:
    """Transforms from the frame of a body pose to `base_link`, and from there to the URDF's links, with the pose's stamp.

    Args: mounting: rotation (3, 3) from the axes of `imu_link` to the box's.
    """
    at, to = body.pose.position, body.pose.orientation
    center, base = np.array([at.x, at.y, at.z]), np.array([to.w, to.x, to.y, to.z])
    places = rotated(matrix_of(base).T, np.vstack([robot.joints_m(), robot.box_m()]) - center)
    turns = relative_quaternion(base, robot.quaternions())
    header = Header(stamp=body.header.stamp, frame_id=prefix + BASE)
    links = [_transform(header, prefix + name, places[index], turns[index]) for name, index in LINKS.items()]
    box = Header(stamp=body.header.stamp, frame_id=prefix + BOX)
    links.append(_transform(box, prefix + IMU, np.zeros(3), quaternion_of(mounting)))
    return TFMessage(transforms=[_transform(body.header, prefix + BASE, center, base), *links])


def _transform(header: Header, child: str, position_m: Array, quaternion: Array) -> TransformStamped:
    x, y, z = (float(value) for value in position_m)
    rotation = pose(position_m, quaternion).orientation
    return TransformStamped(
        header=header, child_frame_id=child, transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=rotation)
    )


def joint_states(stamp: Time, lengths_m: Array, speeds_m_s: Array | None = None, forces_n: Array | None = None) -> JointState:
    """Six struts: rest lengths (m), their speeds (m/s) and axial forces (N); what is None is left empty, as not known."""
    message = JointState(header=Header(stamp=stamp), name=STRUT_NAMES, position=[float(length) for length in lengths_m])
    if speeds_m_s is not None:
        message.velocity = [float(speed) for speed in speeds_m_s]
    if forces_n is not None:
        message.effort = [float(force) for force in forces_n]
    return message


def strut_speeds_m_s(robot: Robot) -> Array:
    """Speeds of the rest lengths: each actuator drives at its constant speed until it is there. Shape (6,)."""
    elements = robot.model.elements
    return np.sign(robot.targets_m() - robot.rest_lengths_m()) * elements.strut_gain * elements.strut_speed_m_s


def twin_state(robot: Robot, header: Header) -> TwinState:
    """What a robot's state says by itself; step, events, face and rest are the caller's."""
    return TwinState(
        header=header,
        digest=robot.digest(),
        model_hash=robot.model.hash,
        center_of_mass=point(robot.center_of_mass_m()),
        tendon_force_n=robot.cable_forces_n()[: len(TENDONS)],
        strut_force_n=robot.strut_forces_n(),
        ground_force_n=robot.ground_forces_n(),
    )
