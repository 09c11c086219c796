# SPDX-License-Identifier: Apache-2.0
"""One running stack: what is refused, and rolls."""

import importlib
from functools import partial

import pytest
from action_msgs.msg import GoalStatus
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

from tensegrity_interfaces.msg import BridgeState, FaceObservation, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, SetFace
from tensegrity_lab.stack.processes import wait_until
from tests.tensegrity_robot.stack.test_viewers import viewed_topics

pytestmark = pytest.mark.ros
NEUTRAL = [0.234] * 6
SETTLE_S = 200.0
ARM_CALL = 'ros2 service call /arm tensegrity_interfaces/srv/Arm "{lifted_and_clear: true}"'


def message_class(kind):
    """From "package/msg/Name"."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def published(node, kinds):
    """The topics that somebody publishes; `kinds`: topic -> type, filled."""
    kinds.update({name: types[0] for name, types in node.get_topic_names_and_types()})
    return [name for name in kinds if node.count_publishers(name)]


@pytest.fixture(scope="module")
def stack(module_processes):
    """The whole stack on a virtual prototype without errors of its own, twelve times as fast as life."""
    prototype = module_processes.node("virtual_prototype", "--time-scale", "12", "--perturbation", "0", "--actuators", "ideal")
    module_processes.node("twin")
    module_processes.node("gait_planner", settle_timeout_s=SETTLE_S)  # of robot time, while other tests may load this machine
    module_processes.node("traveller")
    module_processes.node("hardware_bridge", lease_silence_s=5.0)
    prototype.says("ready")
    return module_processes


@pytest.fixture(scope="module")
def stack_operator(stack, domain):
    from tests.stack_operator import Operator

    operator = Operator(domain=domain)
    operator.wait_for_stack()
    yield operator
    operator.close()


@pytest.fixture
def robot(stack_operator):
    """An operator before the running stack, nobody holding the lease."""
    yield stack_operator
    stack_operator.call("disarm", Disarm.Request())
    if stack_operator.bridge.state == BridgeState.FAULT:
        stack_operator.trigger("reset")
    stack_operator.sees(BridgeState.DISARMED)


def test_a_roll_of_a_disarmed_robot_names_the_call_that_arms(robot):
    began = robot.now_ns()
    result = robot.roll("TO5")
    assert not result.success
    assert result.reason == f"the robot is not armed: {ARM_CALL}"
    assert not robot.wrote_since(began)


def test_arming_needs_the_operators_word(robot):
    answer = robot.call("arm", Arm.Request())
    assert not answer.success
    assert "lifted_and_clear is false" in answer.message


def test_a_whole_roll_is_seen_to_land_and_the_next_starts_where_it_ended(robot):
    robot.arm()
    source = robot.observed.face
    target, back = ("TO5", "TC6") if source == "TC6" else ("TC6", "TO5")
    handle = robot.begin_roll(target)
    second = robot.begin_roll(target)
    assert not second.accepted
    answer = robot.end(handle)
    result = answer.result
    assert answer.status == GoalStatus.STATUS_SUCCEEDED, result.reason
    assert (result.success, result.reason) == (True, "")
    assert (result.predicted_face, result.observed_face) == (target, target)
    assert result.face_sequence[0] == source
    assert result.face_sequence[-1] == target
    assert result.gait == f"{result.primitive} {source}→{target}"
    assert 3.0 < result.duration_s < 2 * SETTLE_S, "of the robot's time; the more, the busier the machine"
    assert list(robot.bridge.length_m) == pytest.approx(NEUTRAL, abs=1e-4)
    wait_until(lambda: robot.twin.face == target, 10.0, "the twin")
    again = robot.roll(back)
    assert again.success, again.reason
    assert (again.face_sequence[0], again.observed_face) == (target, back)


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ({"target": "TC9"}, "unknown face 'TC9': valid are TC1..TC8 (closed triangles) and TO1..TO12 (open triangles)"),
        ({"target": "TO1"}, "TO1 is not adjacent to TC6: one roll from TC6 reaches TO5, TO7, TO9"),
        ({"target": "TO5", "primitive": "P99"}, "has no primitive 'P99': valid are P1, P2"),
        ({"target": "TO5", "source": "TC5"}, "TO5 is not adjacent to TC5"),
        ({"target": "TO9", "source": "TC5"}, "the robot is known to stand on TC6, not on TC5: leave source_face empty"),
    ],
)
def test_an_impossible_roll_is_refused_naming_what_is_valid(robot, goal, why):
    robot.arm()
    if robot.observed.face != "TC6":
        assert robot.roll("TC6").success
    began = robot.now_ns()
    answer = robot.end(robot.begin_roll(**goal))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert why in answer.result.reason
    assert not robot.wrote_since(began)


def test_a_command_without_the_lease_is_refused(robot):
    nobody = robot.move((1.0, NEUTRAL))
    assert nobody.reason == "no lease is refused: nobody holds a lease; arm first"
    robot.arm()
    began = robot.now_ns()
    guessed = robot.move((1.0, [0.240] * 6), lease="0123456789abcdef")
    assert not guessed.success
    assert guessed.reason == "this lease is refused: operator holds another one"
    assert not robot.wrote_since(began)


@pytest.fixture
def commander(robot):
    """Somebody who armed the bridge itself and so may command struts."""
    answer = robot.call("bridge/arm", Arm.Request(holder="commander", lifted_and_clear=True))
    assert answer.success, answer.message
    robot.lease = answer.lease
    robot.sees(BridgeState.ARMED)
    yield robot
    robot.lease = ""
    robot.call("bridge/disarm", Disarm.Request(lease=answer.lease))


def test_a_silent_commander_loses_the_lease_and_the_struts_hold(commander):
    handle = commander.begin_motion((300.0, [0.244] * 6), lease=commander.lease)
    commander.moves(handle, 0.0001)
    commander.lease = ""
    answer = commander.end(handle)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "commander was silent for more than 5 s" in answer.result.reason
    held = list(commander.bridge.length_m)
    assert held[0] < 0.2439
    commander.sees(BridgeState.HOLD)
    assert commander.bridge.lease_holder == ""


def test_a_face_can_be_told_and_goes_into_the_event_stream(robot):
    wrong = robot.call("set_face", SetFace.Request(face="TC9"))
    assert not wrong.success
    assert "TC1 to TC8" in wrong.message
    assert not robot.call("set_face", SetFace.Request(face="TC1", source="predicted")).success
    told, twin = [], []
    robot.node.create_subscription(FaceObservation, "bridge/face", lambda m: told.append((m.face, m.source)), 50)
    robot.node.create_subscription(TwinState, "twin/state", lambda m: twin.append(m.face), 50)
    wait_until(lambda: twin and robot.twin.at_rest and robot.is_quiet(), 30.0, "rest")
    assert robot.call("set_face", SetFace.Request(face="TC1")).success
    wait_until(lambda: ("TC1", "operator") in told, 10.0, "the face")
    wait_until(lambda: "TC1" in twin, 10.0, "the twin on TC1")
    assert robot.call("set_face", SetFace.Request(face="TC6")).success
    wait_until(lambda: "TC6" in twin[twin.index("TC1") :], 10.0, "the twin on TC6")


def test_every_topic_that_a_viewer_asks_for_is_published_with_stamp_and_frame(stack, robot):
    """All topics of the live Foxglove layout and of the RViz view, and what they say of themselves."""
    wanted = viewed_topics()
    kinds = {}
    wait_until(lambda: wanted <= set(published(robot.node, kinds)), 10.0, "every topic of the layouts")
    heard = {}
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscriptions = []
    for topic in wanted - {"/rehearsal", "/travel/path", "/travel/goal"}:  # published before a roll, and on a travel, only
        profile = latched if topic in ("/bridge/state", "/bridge/face", "/twin/face", "/keep_in") else qos_profile_sensor_data
        subscriptions.append(
            robot.node.create_subscription(message_class(kinds[topic]), topic, lambda m, t=topic: heard.setdefault(t, m), profile)
        )
    wait_until(lambda: len(heard) == len(subscriptions), 20.0, f"a message on each of {sorted(wanted)}")
    for subscription in subscriptions:
        robot.in_executor(partial(robot.node.destroy_subscription, subscription))
    for topic, message in heard.items():
        headers = [m.header for m in message.markers] if topic == "/twin/markers" else [message.header]
        assert headers, topic
        assert all(header.stamp.sec > 1.7e9 for header in headers), topic
        if topic.rsplit("/", 1)[1] in ("markers", "pose", "observed_joints"):
            assert {header.frame_id for header in headers} == {"odom"}, topic


@pytest.mark.slow
def test_a_twin_that_is_started_again_joins_where_the_robot_stands(stack, robot):
    digests = {}
    robot.node.create_subscription(type(robot.twin), "twin/state", lambda m: digests.setdefault(m.first_seq, m), 10)
    wait_until(lambda: digests, 10.0, "the twin")
    (first,) = digests
    twin = next(process for process in stack._started if process.name == "twin")
    twin.kill()
    stack.node("twin").says("the event stream begins")
    wait_until(lambda: any(seq > first for seq in digests), 30.0, "a twin that joined late")
    late = digests[max(digests)]
    assert late.detail.startswith(f"began on {robot.observed.face}")
    assert late.first_seq > first
