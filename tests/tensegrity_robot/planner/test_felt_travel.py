# SPDX-License-Identifier: Apache-2.0
"""A real port (a board behind a pty), a robot whose face is felt and that nobody sees: it travels only within an area."""

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient

from tensegrity_interfaces.action import Travel
from tensegrity_interfaces.srv import SetFace
from tests.failures.robot_failures import board, calibration_of

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.mark.parametrize("area", ["", "-1 -1, 2 -1, 2 1.5"])
def test_it_does_not_travel_hands_free_without_an_area(processes, operator, tmp_path, area):
    processes.node("twin")
    processes.node("gait_planner", keep_in=area, rehearse_members=0)
    traveller = processes.node("traveller")
    with board(answers=True) as port:
        calibration = calibration_of(type("Lab", (), {"folder": tmp_path})(), "blue", 48.0)
        processes.node("hardware_bridge", port=port, calibration=calibration, record=False).says("DISARMED, nothing moves")
        operator.wait_for_stack(observer=False)
        request = SetFace.Request(face="TC6", source="imu", detail="99.9 %")
        assert operator.call("set_face", request).success
        operator.wait(lambda: operator.observed is not None and operator.observed.source == "imu", "the sensor's word", 20.0)
        operator.set_face("TC6")  # a person's word later on changes nothing
        goal = Travel.Goal(goal=PoseStamped())
        goal.goal.header.frame_id, goal.goal.pose.position.x = "odom", 0.5
        travels = ActionClient(operator.node, Travel, "travel")
        handle = operator.send(travels, goal, "travel", lambda feedback: None)
        refusal = "set an area that it stays in first (keep_in of the planner)"
        if area:
            assert handle.accepted
            operator.cancel(handle)
            assert refusal not in operator.end(handle, 60.0).result.reason
        else:
            ended = operator.end(handle, 60.0).result.reason if handle.accepted else traveller.output
            assert refusal in ended
