# SPDX-License-Identifier: Apache-2.0
"""How the executables start, alone and together, and how they refuse to."""

import math
import os
import signal
import tty
from importlib.resources import files

import pytest
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm, FaceGraph
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import wait_until
from tests.scale import few

pytestmark = pytest.mark.ros


@pytest.fixture
def real_port():
    """A pty of ours: to the bridge, a real port."""
    near, far = os.openpty()
    tty.setraw(far)
    yield os.ttyname(far)
    os.close(near)
    os.close(far)


@pytest.mark.slow
def test_all_start_with_no_argument_and_the_bridge_waits_for_a_prototype(processes, operator):
    bridge, twin, planner = (processes.node(name) for name in ("hardware_bridge", "twin", "gait_planner"))
    bridge.says("start one with `ros2 run tensegrity_robot virtual_prototype`")
    twin.says("stands on TC6")
    planner.says("library robust")
    wait_until(lambda: operator.bridge is not None, 20.0, "the bridge's state")
    assert operator.bridge.state == BridgeState.DISARMED
    assert not operator.bridge.link_ok
    refused = operator.roll("TO5")
    assert not refused.success
    _shows_the_face_graph(operator)
    assert "ros2 run tensegrity_robot virtual_prototype" in refused.reason

    processes.node("virtual_prototype", "--time-scale", "10")
    bridge.says("DISARMED, nothing moves")
    operator.wait_for_stack()
    assert operator.bridge.virtual_port
    assert operator.bridge.time_scale == 10.0
    assert bridge.output.count("ros2 run tensegrity_robot virtual_prototype") == 1
    assert not any(not message.heartbeat for message in operator.sent)
    assert processes.stop() == {"hardware_bridge": 0, "gait_planner": 0, "twin": 0, "virtual_prototype": 0}


def _shows_the_face_graph(operator) -> None:
    """The planner tells gaits, odds and routes, whatever the bridge does."""

    def ask(**words):
        return operator.call("face_graph", FaceGraph.Request(**words))

    everything = ask(all_gaits=True)
    assert everything.success, everything.message
    assert len(everything.gaits) == 24 * 40
    best = ask(source_face="TC6", target_face="TO5").gaits
    others = ask(source_face="TC6", target_face="TO5", all_gaits=True).gaits
    assert len(best) == 1
    assert best[0].odds == max(gait.odds for gait in others)
    route = ask(source_face="TC6", target_face="TC1")
    assert [gait.target_face for gait in route.gaits][-1] == "TC1"
    assert route.odds == pytest.approx(math.prod(gait.odds for gait in route.gaits))
    assert "unknown face 'TX'" in ask(source_face="TX").message


def one_line_error(process) -> str:
    assert process.ends() == 1, process.output
    lines = [line for line in process.output.splitlines() if line.strip()]
    assert len(lines) == 1, process.output
    assert lines[0].startswith("error: ")
    return lines[0]


@pytest.mark.parametrize("copied", few([True, False], 1))
def test_a_real_robot_is_not_armed_with_the_virtual_prototypes_calibration(real_port, processes, operator, copied):
    unedited = files("hardware_bridge") / "data" / "calibration_default.yaml"
    processes.node("hardware_bridge", port=real_port, **({"calibration": unedited} if copied else {}))
    answer = operator.call("bridge/arm", Arm.Request(lifted_and_clear=True, confirmed_lengths_m=[0.234] * 6))
    assert not answer.success
    assert "the calibration is the virtual prototype's: measure the robot's own" in answer.message


def test_a_silent_board_and_a_nameless_robot_are_told_and_not_armed(real_port, processes, operator):
    text = (files("hardware_bridge") / "data" / "calibration_default.yaml").read_text(encoding="utf-8")
    own = processes.folder / "own.yaml"
    own.write_text(text.replace("stroke_mm: [-50, 50]", "stroke_mm: [-49, 49]"), encoding="utf-8")
    bridge = processes.node("hardware_bridge", port=real_port, calibration=own)
    bridge.says("a robot without a name, calibration")
    bridge.says(f'add a line such as robot: "blue one" to {own}')
    answer = operator.call("bridge/arm", Arm.Request(lifted_and_clear=True, confirmed_lengths_m=[0.234] * 6))
    assert not answer.success
    assert "has never answered on" in answer.message
    assert "if it cannot answer, start the bridge with silent_board:=true" in answer.message


def test_a_real_port_has_no_time_scale(real_port, processes):
    error = one_line_error(processes.node("hardware_bridge", port=real_port, time_scale=2.0))
    assert "valid is 1 only" in error


@pytest.mark.slow
def test_another_board_than_the_virtual_prototypes_is_a_one_line_error(processes):
    processes.node("virtual_prototype", "--board", "maestro:crc").says("ready")
    error = one_line_error(processes.node("hardware_bridge", board="ssc32"))
    assert "board is ssc32, but the virtual prototype at" in error
    assert "is for maestro:crc; set the board to maestro:crc" in error


@pytest.mark.parametrize(
    ("node", "parameters", "why"),
    few(
        [
            ("twin", {"rate_hz": 500.0}, "parameter rate_hz: valid is a decimal number, such as 1.0, from 1 to 200"),
            ("gait_planner", {"library": "nonesuch"}, "shipped are:"),
            ("hardware_bridge", {"board": "arduino", "port": "/dev/null"}, "board is 'arduino', valid is lsc, ssc32, or maestro"),
            ("twin", {"mode": "watch"}, "parameter mode is 'watch': valid is 'follow' or 'standalone'"),
            ("twin", {"start_face": "TC9"}, "unknown face 'TC9': valid are TC1..TC8"),
            ("twin", {"prototype_file": "/nowhere.yaml"}, "cannot read prototype file /nowhere.yaml"),
            ("gait_planner", {"settle_timeout_s": "soon"}, "parameter settle_timeout_s: valid is a decimal number"),
            ("hardware_bridge", {"calibration": "/nowhere.yaml", "port": "/dev/null"}, "calibration /nowhere.yaml: cannot be read"),
            ("hardware_bridge", {"port": "spy:///dev/null"}, "spy:// is not taken: it hides the device behind it"),
            ("hardware_bridge", {"board": "ssc32", "baud": 9600, "port": "/dev/null"}, "baud is 9600, valid is at least"),
        ],
        3,
    ),
)
def test_a_bad_parameter_is_a_one_line_error(processes, node, parameters, why):
    assert why in one_line_error(processes.node(node, **parameters))


def test_the_bridge_goes_through_its_life_by_lifecycle_calls(processes, operator):
    processes.node("virtual_prototype", "--time-scale", "10").says("ready")
    processes.node("hardware_bridge", autostart=False)
    change = operator.node.create_client(ChangeState, "hardware_bridge/change_state")
    get = operator.node.create_client(GetState, "hardware_bridge/get_state")
    wait_until(lambda: change.service_is_ready() and get.service_is_ready(), 30.0, "lifecycle services")

    def state() -> int:
        return operator.result(get.call_async(GetState.Request()), "get_state").current_state.id

    def go(transition: int) -> bool:
        request = ChangeState.Request()
        request.transition.id = transition
        return operator.result(change.call_async(request), "change_state").success

    def has_answered() -> bool:  # a request to a server that has not met this client yet is lost
        try:
            return bool(operator.result(get.call_async(GetState.Request()), "get_state", 2.0))
        except StackError:
            return False

    wait_until(has_answered, 30.0, "an answer of the bridge")
    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    assert go(1)
    assert state() == State.PRIMARY_STATE_INACTIVE
    wait_until(lambda: operator.bridge is not None and operator.bridge.link_ok, 10.0, "the link")
    refused = operator.move((1.0, [0.234] * 6))
    assert "the bridge is inactive: ros2 lifecycle set /hardware_bridge activate" in refused.reason
    assert go(3)
    assert state() == State.PRIMARY_STATE_ACTIVE
    assert go(4)
    assert go(2)
    wait_until(lambda: not operator.bridge.link_ok, 10.0, "the end of the link")
    assert operator.move((1.0, [0.234] * 6)).reason.startswith("unconfigured: ros2 lifecycle set /hardware_bridge configure")


@pytest.mark.slow
def test_a_standalone_twin_is_a_robot_that_takes_commands(processes, operator):
    twin = processes.node("twin", mode="standalone", time_scale=5.0, rate_hz=50.0, start_face="TO1")
    lengths: list[list[float]] = []
    operator.node.create_subscription(JointState, "twin/joint_states", lambda m: lengths.append(list(m.position)), 10)
    command = operator.node.create_publisher(JointTrajectory, "twin/command", 10)
    wait_until(lambda: lengths and command.get_subscription_count(), 30.0, "the twin")
    assert lengths[-1] == pytest.approx([0.234] * 6)
    target = [0.234, 0.240, 0.234, 0.228, 0.234, 0.234]

    def say(goal: list[float]) -> None:
        names = [f"S{number}" for number in range(1, 7)]
        command.publish(JointTrajectory(joint_names=names, points=[JointTrajectoryPoint(positions=goal)]))

    say(target)
    wait_until(lambda: lengths[-1] == pytest.approx(target), 10.0, "the struts")
    say([0.234 + 0.046, *target[1:]])
    twin.says("twin/command refused: S1: stroke 46 mm is outside the limit ±45 mm")
    assert lengths[-1] == pytest.approx(target)
    wait_until(lambda: operator.twin is not None and operator.twin.at_rest, 10.0, "rest")
    assert operator.twin.face == "TO1"
    twin.signal(signal.SIGTERM)
    assert twin.ends() == 0
