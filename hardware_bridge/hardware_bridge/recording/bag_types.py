# SPDX-License-Identifier: Apache-2.0
"""What the tools read of a bag's messages: the types of our topics and their fields, old versions' included.

A field that a definition gives the right type is decoded to the right type; so whoever reads it need only ask for its value.
"""

import re
from functools import lru_cache

from hardware_bridge.recording.message_definitions import FIELD

TOPICS: dict[str, tuple[str, str]] = {
    "bridge/struts_sent": (
        "tensegrity_interfaces/msg/StrutsSent",
        "Header header, uint64 seq, int64 robot_time_ns, bool heartbeat, float64[6] length_m, uint16[6] pulse_us, "
        "uint16 duration_ms, uint8[] frame",
    ),
    "bridge/face": (
        "tensegrity_interfaces/msg/FaceObservation",
        "Header header, uint64 seq, int64 robot_time_ns, string face, string source, bool settled",
    ),
    "twin/state": (
        "tensegrity_interfaces/msg/TwinState",
        "Header header, int64 robot_time_ns, uint64 step, uint64 first_seq, uint64 last_seq, string digest, string model_hash, "
        "string face, bool at_rest",
    ),
    "bridge/asked": (
        "trajectory_msgs/msg/JointTrajectory",
        "Header header, string[] joint_names, JointTrajectoryPoint[] points",
    ),
    "bridge/observed_joints": ("geometry_msgs/msg/PoseArray", "Header header, Pose[] poses"),
    "bridge/trial": (
        "tensegrity_interfaces/msg/TrialRecord",
        "Header header, string event, uint32 number, string session, string experimenter, string robot, bool virtual_robot, "
        "string library, string library_hash, string primitive, string roll_class, string source, string target, uint32 repeat, "
        "bool proper, int8[6] policy_mm, float64 odds, bool predicted, string outcome, string reason, string observed_face, "
        "string[] faces, Time began, float64 robot_s, float64 wall_s, float64 battery_v, string faults, string bag, "
        "float64 bag_offset_s",
    ),
    "rehearsal": ("tensegrity_interfaces/msg/Rehearsal", "Header header, string source_face, RehearsedGait[] gaits"),
    "bridge/state": ("tensegrity_interfaces/msg/BridgeState", "Header header, string state"),
    "imu/data": ("sensor_msgs/msg/Imu", "Header header, Vector3 angular_velocity, Vector3 linear_acceleration"),
    "face_estimate": ("tensegrity_interfaces/msg/FaceEstimate", "Header header, float64[4] mounting"),
}
"""Topic -> type and its fields that are read."""

_PARTS = {
    "Header": ("std_msgs/Header", "Time stamp"),
    "Time": ("builtin_interfaces/Time", "int32 sec, uint32 nanosec"),
    "JointTrajectoryPoint": ("trajectory_msgs/JointTrajectoryPoint", "float64[] positions"),
    "Pose": ("geometry_msgs/Pose", "Point position"),
    "Vector3": ("geometry_msgs/Vector3", "float64 x, float64 y, float64 z"),
    "Point": ("geometry_msgs/Point", "float64 x, float64 y, float64 z"),
    "RehearsedGait": (
        "tensegrity_interfaces/RehearsedGait",
        "string target_face, string primitive, uint32 members, float64 odds, string[] faces",
    ),
}
"""What these fields are made of: type, and its fields that are read."""

MOST_DEFINITION = 200_000
_EMPTY_ARRAY = re.compile(r"\[\s*0+\s*\]")


@lru_cache(maxsize=256)
def misfit_of(topic: str, type_name: str, definition: str, encoding: str) -> str | None:
    """Why a topic's messages cannot be read as what its name says; None: they can be, or it is not a topic of ours."""
    if len(definition) > MOST_DEFINITION or _EMPTY_ARRAY.search(definition):
        return "its definition is none that a message has"
    ours = next((TOPICS[name] for name in TOPICS if topic == name or topic.endswith("/" + name)), None)
    if ours is None:
        return None
    wanted_type, wanted = ours
    if encoding != "cdr":
        return f"is in {encoding[:30]}, valid is cdr with a ros2msg definition"
    if type_name != wanted_type:
        return f"is of type {type_name[:60]}, valid is {wanted_type}"
    found = _fields_of(definition)
    asked = [("", wanted)]
    for part, fields in asked:  # it grows meanwhile
        names = fields.split(", ")
        missing = set(names) - found.get(part, set())
        if missing:
            return f"has no field {min(missing)}{f' in {part}' if part else ''}"
        kinds = [name.split()[0].removesuffix("[]") for name in names]
        asked += [_PARTS[kind] for kind in kinds if kind in _PARTS]
    return None


def _fields_of(definition: str) -> dict[str, set[str]]:
    """Per part the fields "type name", types without their package."""
    found: dict[str, set[str]] = {}
    part = ""
    for line in definition.splitlines():
        text = line.split("#")[0].strip()
        if text.startswith("==="):
            continue
        if text.startswith("MSG:"):
            part = text.removeprefix("MSG:").strip()
            continue
        match = FIELD.match(text)
        if match is not None:
            kind = match[1].rsplit("/", 1)[-1] + (match[2] or "")
            found.setdefault(part, set()).add(f"{kind} {match[3]}")
    return found
