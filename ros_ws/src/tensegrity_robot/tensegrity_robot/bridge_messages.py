"""The bridge's events and snapshots as messages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from hardware_bridge.events import FaceEvent, SentEvent, Snapshot
from hardware_bridge.observation import Observation
from hardware_bridge.trajectory import Trajectory
from tensegrity_interfaces.msg import BridgeState, FaceObservation, StrutsSent
from tensegrity_robot.messages import pose


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
    )


def bridge_state(snapshot: Snapshot, bag: str, stamp: Time) -> BridgeState:
    """The bridge at one instant."""
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
        time_scale=snapshot.time_scale,
        length_m=tuple(lengths),
        bag=bag,
        calibration_hash=snapshot.calibration_hash,
        frames_sent=snapshot.frames_sent,
        write_errors=snapshot.write_errors,
        battery_v=math.nan if snapshot.battery_mv is None else snapshot.battery_mv / 1e3,
    )


def no_bridge_state(reason: str, stamp: Time) -> BridgeState:
    """The bridge without a port."""
    state = BridgeState(header=Header(stamp=stamp), state=BridgeState.DISARMED, reason=reason, time_scale=1.0)
    state.length_m = [math.nan] * 6
    state.battery_v = math.nan
    return state


def observed_joints(observation: Observation, header: Header) -> PoseArray:
    """Twelve joints, then the box, as somebody outside saw them."""
    return PoseArray(header=header, poses=[pose(place) for place in (*observation.joints_m, observation.box_m)])


def trajectory_of(message: JointTrajectory) -> Trajectory:
    """The bridge's trajectory. Raises TrajectoryError."""
    times = [point.time_from_start.sec + point.time_from_start.nanosec * 1e-9 for point in message.points]
    return Trajectory.from_names(list(message.joint_names), times, [list(point.positions) for point in message.points])


# ---- diagnostics ----------------------------------------------------------------------------------------------------

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE


class LogFacts(NamedTuple):
    """A bag as diagnostics tell it; `most_waiting`: messages that ever waited for the disk at once."""

    path: str
    messages: int
    most_waiting: int
    fault: str


def diagnostics(
    node: str, snapshot: Snapshot | None, log: LogFacts | None, observer: bool | None, hint: str, stamp: Time
) -> DiagnosticArray:
    """What is well and what is not, with names as REP 107 asks: "node: what".

    Args:
        log: of the bag; None: not recording.
        observer: whether the observer is there; None: none is expected.
        hint: what to do while there is no bridge.
    """
    if snapshot is None:
        return DiagnosticArray(header=Header(stamp=stamp), status=[_status(f"{node}: link", STALE, hint, "", ())])
    port = snapshot.port
    statuses = [
        _link(node, snapshot),
        _supervisor(node, snapshot),
        _status(
            f"{node}: frames",
            WARN if snapshot.congested_periods else OK,
            "the port held back frames" if snapshot.congested_periods else "on time",
            port,
            (("late periods", snapshot.late_periods), ("congested periods", snapshot.congested_periods)),
        ),
        _log(node, log, port),
    ]
    if observer is not None:
        told = "is there" if observer else "is not there: faces are only predicted"
        statuses.append(_status(f"{node}: observer", OK if observer else WARN, told, port, ()))
    return DiagnosticArray(header=Header(stamp=stamp), status=statuses)


def _link(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    battery = "not known" if snapshot.battery_mv is None else f"{snapshot.battery_mv / 1e3:.2f}"
    values = (
        ("port", snapshot.port),
        ("virtual", snapshot.virtual_port),
        ("frames sent", snapshot.frames_sent),
        ("write errors", snapshot.write_errors),
        ("servo supply [V]", battery),
    )
    told = "open" if snapshot.link_ok else "lost: check power and link, then reset"
    return _status(f"{node}: link", OK if snapshot.link_ok else ERROR, told, snapshot.port, values)


def _supervisor(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    level = {BridgeState.FAULT: ERROR, BridgeState.HOLD: WARN}.get(str(snapshot.mode), OK)
    told = f"{snapshot.mode}: {snapshot.reason}" if snapshot.reason else str(snapshot.mode)
    values = (("lease holder", snapshot.lease_holder or "nobody"), ("homed", snapshot.homed), ("moving", snapshot.moving))
    return _status(f"{node}: supervisor", level, told, snapshot.port, values)


def _log(node: str, log: LogFacts | None, port: str) -> DiagnosticStatus:
    if log is None:
        return _status(f"{node}: log", OK, "not recording", port, ())
    values = (("bag", log.path), ("messages", log.messages), ("most waiting", log.most_waiting))
    return _status(f"{node}: log", ERROR if log.fault else OK, log.fault or "growing", port, values)


def _status(name: str, level: bytes, told: str, hardware: str, values: Sequence[tuple[str, object]]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values]
    return DiagnosticStatus(level=level, name=name, message=told, hardware_id=hardware, values=pairs)
