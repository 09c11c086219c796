# SPDX-License-Identifier: Apache-2.0
"""The real judge of shapes behind the real node."""

import time

import pytest

from hardware_bridge.errors import may_be_sent_again
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until

pytestmark = pytest.mark.ros

MID = [0.234] * 6


@pytest.fixture
def armed(processes, operator, request):
    processes.node("virtual_prototype", "--time-scale", "8").says("ready")
    words = getattr(request, "param", ())
    processes.node("hardware_bridge", *words, record=False).says("DISARMED, nothing moves")
    answer = operator.call("bridge/arm", Arm.Request(holder="test", lifted_and_clear=True, confirmed_lengths_m=MID))
    assert answer.success, answer.message
    operator.lease = answer.lease
    wait_until(lambda: operator.bridge is not None and operator.bridge.state == BridgeState.ARMED, 30.0, "ARMED")
    return operator


def moved(operator):
    return sum(not message.heartbeat for message in operator.sent)


@pytest.mark.slow
def test_a_shape_that_the_structure_must_not_take_is_refused_whole(armed):
    before = moved(armed)
    result = armed.move((3.0, [0.189] * 6), lease=armed.lease)
    assert not result.success
    assert "is not permitted: 24 tendons are slack (T1, T2" in result.reason
    assert "the limit is 6" in result.reason
    assert moved(armed) == before
    assert armed.bridge.state == BridgeState.ARMED


def test_stop_does_not_wait_for_the_judge_and_what_was_judged_is_refused(armed):
    before = moved(armed)
    zigzag = [(5.0 * knot, [0.234 + (0.03 if knot % 2 else -0.03), *MID[1:5], 0.234 + 0.0006 * knot]) for knot in range(1, 37)]
    asked = time.monotonic()
    goal = armed.begin_motion(*zigzag, lease=armed.lease, once=True)
    ended = armed.begun(goal.get_result_async)
    pressed = time.monotonic()
    assert armed.trigger("stop").success
    stop_s = time.monotonic() - pressed
    wait_until(lambda: armed.bridge.state == BridgeState.FAULT, 10.0, "the fault")
    assert not ended.done(), "the 2000 shapes are judged still"
    wait_until(ended.done, 60.0, "the verdict")
    assert stop_s < 0.5 * (time.monotonic() - asked), "stop waited for the judge"
    result = ended.result().result
    assert not result.success
    assert "stop pressed" in result.reason
    assert moved(armed) <= before + 1, "the hold, and nothing that moves"


AGE_S = 0.1


@pytest.mark.slow
@pytest.mark.parametrize("armed", [("--ros-args", "-p", f"goal_age_s:={AGE_S}")], indirect=True, ids=["young"])
def test_a_goal_is_too_old_if_it_took_too_long_to_judge_and_may_be_sent_again(armed):
    before = moved(armed)
    there_and_back = [
        (3.7 * knot, [0.234 + (0.027 if knot % 2 else -0.027), *MID[1:5], 0.234 - 0.0015 * knot]) for knot in range(1, 14)
    ]
    result = armed.end(armed.begin_motion(*there_and_back, lease=armed.lease, once=True)).result
    assert not result.success
    assert may_be_sent_again(result.reason), result.reason
    assert float(result.reason.split()[2]) > AGE_S, "650 shapes take longer, on any machine"
    assert moved(armed) == before
    goal = armed.begin_motion(*there_and_back, lease=armed.lease)
    wait_until(lambda: moved(armed) > before, 10.0, "the same motion, judged already")
    armed.cancel(goal)
