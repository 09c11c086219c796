# SPDX-License-Identifier: Apache-2.0
"""The planner tries a roll on perturbed twins before the robot does it."""

import pytest

from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Disarm
from tensegrity_lab.stack.processes import wait_until

pytestmark = pytest.mark.ros


@pytest.fixture
def robot(processes, domain):
    """A robot without errors, and a planner that expects the worst: steep ground and ill-made robots, and wants certainty."""
    from tests.stack_operator import Operator

    prototype = processes.node("virtual_prototype", "--time-scale", "12", "--perturbation", "0", "--actuators", "ideal")
    processes.node("twin")
    processes.node(
        "gait_planner", settle_timeout_s=200.0, rehearse_scale=0.3, rehearse_incline_deg=12.0, least_odds=1.0, rehearse_members=8
    )
    processes.node("hardware_bridge")
    prototype.says("ready")
    operator = Operator(domain=domain)
    operator.wait_for_stack()
    yield operator
    operator.call("disarm", Disarm.Request())
    operator.close()


@pytest.mark.slow
def test_an_unlikely_roll_is_refused_with_its_odds_and_rolls_only_if_told_to(robot):
    robot.arm()
    robot.sees(BridgeState.ARMED)
    began = robot.now_ns()
    result = robot.roll("TO5")
    assert not result.success
    assert "of 8 rehearsals" in result.reason
    assert "say anyway in the goal" in result.reason
    assert not robot.wrote_since(began)
    told = robot.rehearsal
    assert (told.source_face, told.gaits[0].target_face, len(told.gaits)) == ("TC6", "TO5", 3)
    assert len({gait.target_face for gait in told.gaits}) == 3
    for gait in told.gaits:
        assert gait.members == 8 == sum(gait.counts)
        assert gait.odds == gait.successes / 8
        assert gait.low <= gait.odds <= gait.high
    assert result.odds == told.gaits[0].odds < 1.0

    assert robot.end(robot.begin_roll("TO5", anyway=True)).result.success
    assert "rehearsing" in robot.feedback
    wait_until(lambda: robot.observed.face == "TO5", 10.0, "the observer's word")
