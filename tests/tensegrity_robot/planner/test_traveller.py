# SPDX-License-Identifier: Apache-2.0
"""The traveller before a real stack: arrives, replans, is refused, is called off."""

import math

import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient

from tensegrity_interfaces.action import Travel
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Disarm
from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros import qos
from tests.stack_operator import Operator

pytestmark = pytest.mark.ros
LIMIT_S = 120.0


class Client:
    """Asks for travels.

    Attributes:
        feedback: all of the last travel. paths: lengths of the ways shown.
    """

    def __init__(self, operator):
        self.operator = operator
        self.feedback, self.paths = [], []
        self._travels = ActionClient(operator.node, Travel, "travel")
        operator.node.create_subscription(Path, "travel/path", lambda m: self.paths.append(len(m.poses)), qos.LATCHED)
        self.goals = operator.node.create_publisher(PoseStamped, "goal_pose", 10)

    def begin(self, x, y, frame="odom", **more):
        """The goal's handle."""
        self.feedback = []
        goal = Travel.Goal(goal=pose(x, y, frame), **more)
        return self.operator.send(self._travels, goal, "travel", self.feedback.append)

    def click(self, x, y, frame="odom", age_s=0.0):
        """A goal on goal_pose, stamped so long ago; None: not at all."""
        goal = pose(x, y, frame)
        if age_s is not None:
            stamp_ns = self.operator.now_ns() - round(age_s * 1e9)
            goal.header.stamp.sec, goal.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        self.goals.publish(goal)

    def end(self, handle):
        """The answer at its end."""
        return self.operator.end(handle, LIMIT_S)


def pose(x, y, frame="odom"):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    return message


@pytest.fixture(scope="module")
def client(module_processes, domain):
    prototype = module_processes.node("virtual_prototype", "--time-scale", "12", "--perturbation", "0", "--actuators", "ideal")
    module_processes.node("twin")
    # settle_timeout_s: of robot time, while other tests may load this machine
    module_processes.node("gait_planner", settle_timeout_s=200.0, keep_in="-2 -2, 2 -2, 2 2, -2 2")
    traveller = module_processes.node("traveller")
    module_processes.node("hardware_bridge", lease_silence_s=5.0)
    prototype.says("ready")
    operator = Operator(domain=domain)
    operator.wait_for_stack()
    client = Client(operator)
    client.traveller = traveller
    yield client
    operator.close()


@pytest.fixture
def armed(client):
    client.operator.arm()
    yield client
    client.operator.call("disarm", Disarm.Request())
    client.operator.sees(BridgeState.DISARMED)


def test_a_disarmed_robot_does_not_travel_and_the_call_that_arms_is_named(client):
    answer = client.end(client.begin(0.2, 0.0))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "the robot is not armed: ros2 service call /arm" in answer.result.reason
    assert answer.result.rolls == 0


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ({"x": 0.2, "y": 0.0, "frame": "map"}, "frame 'map': valid is 'odom'"),
        ({"x": math.nan, "y": 0.0}, "x and y must be numbers"),
        ({"x": 2.5, "y": 0.0}, "the goal 2.5, 0 m is outside of the keep-in area"),
        ({"x": 0.2, "y": 0.0, "reach_m": -1.0}, "reach_m is -1.0"),
    ],
)
def test_an_impossible_goal_is_rejected_with_the_reason_in_the_log(client, goal, why):
    assert not client.begin(**goal).accepted
    client.traveller.says(why, limit_s=5.0)


@pytest.mark.slow
def test_it_rolls_to_a_place_and_tells_how(armed):
    answer = armed.end(armed.begin(0.15, 0.05))
    result = answer.result
    assert answer.status == GoalStatus.STATUS_SUCCEEDED, result.reason
    assert result.left_m <= 0.08
    assert result.rolls == len(result.face_sequence) - 1 >= 1
    assert result.face_sequence[-1] == armed.operator.observed.face
    assert 0.0 < result.straight_m - result.left_m <= result.path_m
    assert any("rolling to" in told.phase for told in armed.feedback)
    assert max(armed.paths) >= 2, "the way was shown"
    wait_until(lambda: armed.paths[-1] == 0, 5.0, "no way any more")
    there = armed.end(armed.begin(0.15, 0.05)).result
    assert (there.success, there.rolls) == (True, 0)


@pytest.mark.parametrize(
    ("age_s", "why"), [(3600.0, "it was stamped 3600.0 s ago, valid is 2 s"), (None, "it has no stamp, valid is 2 s")]
)
def test_a_goal_of_a_recording_moves_nothing(armed, age_s, why):
    began = armed.operator.now_ns()
    armed.click(1.5, 0.0, age_s=age_s)
    armed.traveller.says(f"goal_pose ignored: {why}", limit_s=20.0)
    assert not armed.operator.wrote_since(began)


def test_a_goal_pose_starts_a_travel_another_one_replaces_it_and_cancel_ends_it(armed):
    armed.click(1.5, 0.0)
    armed.traveller.says("travel to 1.50, 0.00 m", limit_s=20.0)
    wait_until(lambda: armed.paths and armed.paths[-1] > 5, 20.0, "the way to a far goal")
    assert not armed.begin(0.2, 0.0).accepted, "one at a time"
    armed.click(-1.5, 0.0)
    armed.traveller.says("replaced by a new goal_pose", limit_s=60.0)
    armed.traveller.says("travel to -1.50, 0.00 m", limit_s=20.0)
    armed.click(0.0, 0.0, "map")
    armed.traveller.says("goal_pose ignored: the goal is in frame 'map'", limit_s=10.0)
    armed.operator.trigger("stop")
    armed.traveller.says("travel failed: the bridge is in FAULT (stop pressed)", limit_s=30.0)
    armed.operator.trigger("reset")
