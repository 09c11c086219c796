# SPDX-License-Identifier: Apache-2.0
"""Bytes of messages: exactly as long as readers that are not ours expect."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseArray
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hardware_bridge.recording.message_definitions import ShareSchemas
from tensegrity_interfaces.msg import BridgeState, FaceObservation, StrutsSent, TrialRecord, TwinState
from tensegrity_robot.ros.cdr import wire_bytes

POINT = JointTrajectoryPoint(positions=[0.1] * 6)
MESSAGES = [
    JointState(),
    JointState(name=["S1"], position=[1.0]),
    JointState(name=["S1", "S22"], velocity=[1.0, 2.0]),
    JointState(name=["é"], effort=[1.0]),
    JointTrajectory(joint_names=["S1"], points=[POINT, JointTrajectoryPoint(), POINT]),
    PoseArray(poses=[Pose(), Pose()]),
    DiagnosticArray(status=[DiagnosticStatus(name="a", values=[KeyValue(key="k", value="v")]), DiagnosticStatus()]),
    StrutsSent(seq=1, frame=b"\x55\x55\x03"),
    StrutsSent(heartbeat=True, length_m=[0.234] * 6),
    FaceObservation(face="TC6", detail="x"),
    BridgeState(state="ARMED"),
    TwinState(digest="abc", at_rest=True),
    TrialRecord(event=TrialRecord.TRIAL, number=7, faces=["TC6", "TO5"], policy_mm=[-45, 0, 1, 2, 3, 45], bag="a.mcap"),
]


@pytest.fixture(scope="module")
def store():
    store, schemas = get_typestore(Stores.ROS2_JAZZY), ShareSchemas()
    for kind in (StrutsSent, FaceObservation, BridgeState, TwinState, TrialRecord):
        name = f"tensegrity_interfaces/msg/{kind.__name__}"
        types = get_types_from_msg(schemas.schema_text(name), name)
        store.register({own: fields for own, fields in types.items() if own not in store.fielddefs})
    return store


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_is_as_long_as_a_strict_reader_expects(message, store):
    name = f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"
    data = wire_bytes(message)
    again = bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name))
    assert len(data) == len(again)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_ros_reads_it_back(message):
    assert deserialize_message(wire_bytes(message), type(message)) == message
