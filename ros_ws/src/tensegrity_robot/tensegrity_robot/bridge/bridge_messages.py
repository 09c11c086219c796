# SPDX-License-Identifier: Apache-2.0
"""The bridge's events and snapshots as messages."""

import math

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from hardware_bridge.driver.events import FaceEvent, SentEvent, Snapshot
from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.recording.session_bag import SessionLog
from hardware_bridge.safety.trajectory import Trajectory
from tensegrity_interfaces.msg import BridgeState, FaceObservation, StrutsSent
from tensegrity_robot.ros.conversions import pose, stamp_of


def struts_sent(event: SentEvent, header: Header) -> StrutsSent:
    """A write or a heartbeat."""
    return StrutsSent(
        header=header,
        seq=event.seq,
        robot_time_ns=event.robot_time_ns,
        heartbeat=event.heartbeat,
        length_m=event.lengths_m,
        pulse_us=event.pulses_us,
        duration_ms=event.duration_ms,
        frame=event.frame,
        session=event.session,
    )


def face_observation(event: FaceEvent, header: Header) -> FaceObservation:
    """Somebody saw a face."""
    return FaceObservation(
        header=header,
        seq=event.seq,
        robot_time_ns=event.robot_time_ns,
        face=event.face,
        source=event.source,
        settled=event.settled,
        detail=event.detail,
        session=event.session,
    )


def bridge_state(snapshot: Snapshot, log: SessionLog | None, stamp: Time) -> BridgeState:
    """The bridge and its bag, if there is one, at one instant."""
    well = log is not None and log.path is not None and not log.fault
    began_ns = log.began_ns if log is not None and well else 0
    lengths = (length if known else math.nan for length, known in zip(snapshot.lengths_m, snapshot.known, strict=True))
    return BridgeState(
        header=Header(stamp=stamp),
        robot_time_ns=snapshot.robot_time_ns,
        state=str(snapshot.mode),
        reason=snapshot.reason,
        lease_holder=snapshot.lease_holder,
        port=snapshot.port,
        link_ok=snapshot.link_ok,
        virtual_port=snapshot.virtual_port,
        prototype=snapshot.prototype,
        time_scale=snapshot.time_scale,
        length_m=tuple(lengths),
        bag=str(log.path) if log is not None and well else "",
        bag_began=stamp_of(began_ns),
        bag_messages=log.messages if log is not None and well else 0,
        calibration_hash=snapshot.calibration_hash,
        frames_sent=snapshot.frames_sent,
        write_errors=snapshot.write_errors,
        battery_v=math.nan if snapshot.battery_mv is None else snapshot.battery_mv / 1e3,
        duty_left_s=snapshot.duty_left_s,
        supply_low_v=snapshot.supply_low_v,
        session=snapshot.session,
    )


def no_bridge_state(reason: str, stamp: Time) -> BridgeState:
    """The bridge without a port."""
    state = BridgeState(header=Header(stamp=stamp), state=BridgeState.DISARMED, reason=reason, time_scale=1.0)
    state.length_m = [math.nan] * 6
    state.battery_v = state.duty_left_s = state.supply_low_v = math.nan
    return state


def observed_joints(observation: Observation, header: Header) -> PoseArray:
    """Twelve joints, then the box, as somebody outside saw them."""
    return PoseArray(header=header, poses=[pose(place) for place in (*observation.joints_m, observation.box_m)])


def trajectory_of(message: JointTrajectory) -> Trajectory:
    """The bridge's trajectory. Raises TrajectoryError."""
    times = [point.time_from_start.sec + point.time_from_start.nanosec * 1e-9 for point in message.points]
    return Trajectory.from_names(list(message.joint_names), times, [list(point.positions) for point in message.points])
