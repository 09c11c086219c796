# SPDX-License-Identifier: Apache-2.0
"""Rolls that are ended in the middle: slowly enough that the middle is met on a busy machine, too."""

import signal

import pytest
from action_msgs.msg import GoalStatus

from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm, Disarm
from tensegrity_lab.stack.processes import wait_until
from tests.stack_operator import Operator
from tests.tensegrity_robot.planner.test_traveller import Client

pytestmark = pytest.mark.ros
NEUTRAL = [0.234] * 6
LEASE_S = 10.0  # so long that what ends a motion sooner, on a busy machine too, was not the lease


@pytest.fixture(scope="module")
def stack(module_processes):
    """The whole stack, three times as fast as life."""
    prototype = module_processes.node("virtual_prototype", "--time-scale", "3", "--perturbation", "0", "--actuators", "ideal")
    module_processes.node("twin")
    module_processes.node("gait_planner", settle_timeout_s=200.0)  # of robot time, while other tests may load this machine
    module_processes.node("traveller")
    module_processes.node("hardware_bridge", lease_silence_s=LEASE_S)
    prototype.says("ready")
    return module_processes


@pytest.fixture(scope="module")
def stack_operator(stack, domain):
    operator = Operator(domain=domain)
    operator.wait_for_stack()
    yield operator
    operator.close()


@pytest.fixture
def robot(stack_operator):
    """An operator before the running stack, nobody holding the lease."""
    yield stack_operator
    stack_operator.call("disarm", Disarm.Request())
    stack_operator.sees(BridgeState.DISARMED)


@pytest.mark.slow
def test_a_cancelled_roll_holds_the_struts_and_the_next_returns_to_neutral_first(robot):
    robot.arm()
    source = robot.observed.face
    target = "TO5" if source == "TC6" else "TC6"
    handle = robot.begin_roll(target)
    robot.moves(handle, 0.005)
    assert len(robot.cancel(handle).goals_canceling) == 1
    answer = robot.end(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.reason == "cancelled; the struts hold where they are"
    robot.sees(BridgeState.HOLD)
    wait_until(lambda: _last_frame_holds(robot), 10.0, "the frame that holds")
    wait_until(lambda: robot.twin.at_rest and robot.observed.settled and robot.observed.face, 20.0, "rest on a face")
    answer = robot.end(robot.begin_roll("TO5" if robot.observed.face == "TC6" else "TC6"))
    phases = [phase for phase in robot.feedback if phase != "rehearsing"]
    assert phases[0].endswith("neutral lengths"), robot.feedback
    assert answer.result.success, answer.result.reason


def _last_frame_holds(robot) -> bool:
    """Where the board is between the two frames before. The stream may come after the state, on another topic."""
    earlier, before, last = [message.pulse_us for message in list(robot.sent) if not message.heartbeat][-3:]
    between = [min(a, b) - 1 <= held <= max(a, b) + 1 for a, b, held in zip(earlier, before, last, strict=True)]
    return all(between)


def test_stop_fails_the_running_roll_and_latches(robot):
    robot.arm()
    handle = robot.begin_roll("TO5" if robot.observed.face == "TC6" else "TC6")
    robot.moves(handle, 0.002)
    assert robot.trigger("stop").success
    answer = robot.end(handle)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "the bridge is in FAULT (stop pressed)" in answer.result.reason
    robot.sees(BridgeState.FAULT)
    refused = robot.call("arm", Arm.Request(lifted_and_clear=True))
    assert "stop pressed; remove the cause, then call reset" in refused.message
    assert robot.trigger("reset").success
    robot.sees(BridgeState.DISARMED)
    robot.arm()
    assert list(robot.bridge.length_m) == pytest.approx(NEUTRAL, abs=1e-4)


def test_a_cancelled_travel_holds_the_struts(robot):
    client = Client(robot)
    robot.arm()
    handle = client.begin(1.5, 0.0)
    wait_until(lambda: any("rolling" in told.phase for told in client.feedback), 30.0, "a roll")
    wait_until(lambda: abs(robot.sent[-1].length_m[0] - 0.234) > 0.002, 30.0, "a strut that moves")
    robot.cancel(handle)
    answer = client.end(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert "cancelled" in answer.result.reason
    robot.sees(BridgeState.HOLD)
    began = robot.now_ns()
    robot.hears_more(3)
    assert not robot.wrote_since(began)


@pytest.mark.slow
def test_a_planner_that_ends_in_mid_roll_has_the_struts_held(stack, robot):
    robot.arm()
    handle = robot.begin_roll("TO5" if robot.observed.face == "TC6" else "TC6")
    robot.moves(handle, 0.002)
    planner = next(process for process in stack._started if process.name == "gait_planner")
    planner.signal(signal.SIGTERM)
    wait_until(lambda: robot.bridge.state == BridgeState.HOLD, LEASE_S - 1.0, "HOLD before the lease falls silent")
    assert robot.bridge.reason == "cancelled by its commander"
    assert planner.ends() == 0
    stack.node("gait_planner", settle_timeout_s=200.0).says("library robust")
    wait_until(lambda: not robot.bridge.lease_holder, 40.0, "the end of a lease that nobody gave back")


@pytest.mark.slow
def test_a_roll_of_a_bridge_that_died_ends_with_the_reason(stack, robot):
    robot.arm()
    handle = robot.begin_roll("TO5" if robot.observed.face == "TC6" else "TC6")
    robot.moves(handle, 0.002)
    bridge = next(process for process in stack._started if process.name == "hardware_bridge")
    bridge.kill()
    answer = robot.end(handle)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "the hardware bridge is silent" in answer.result.reason
    again = stack.node("hardware_bridge")
    again.says("DISARMED, nothing moves")
    again.says("messages of a session that was cut short")
    wait_until(lambda: robot.bridge.state == BridgeState.DISARMED and robot.bridge.robot_time_ns > 0, 20.0, "the new bridge")
    assert "the robot is not armed" in robot.roll("TO5").reason
