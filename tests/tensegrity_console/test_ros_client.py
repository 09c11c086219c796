# SPDX-License-Identifier: Apache-2.0
"""What the console keeps of what it hears: no number that is none, no text that steers, nothing that is far too large. Real ROS."""

import json
import math
from queue import Queue

import pytest
from rclpy.task import Future
from std_srvs.srv import Trigger

from tensegrity_console.web.state import Selection, document_of, json_of

pytestmark = pytest.mark.ros
WAIT_S = 20.0


@pytest.fixture
def ros_side(domain, monkeypatch):
    from tensegrity_console.web.ros_client import RosSide

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    side = RosSide()
    yield side
    side.close()


def test_what_anybody_may_publish_neither_blinds_nor_fools_a_page(ros_side, operator):
    from geometry_msgs.msg import Pose, PoseArray, PoseStamped
    from nav_msgs.msg import Path
    from std_msgs.msg import String

    from tensegrity_interfaces.msg import BridgeState
    from tensegrity_lab.stack.processes import wait_until
    from tensegrity_robot.ros import topics

    def publisher(topic):
        made = topic.publisher(operator.node)
        wait_until(lambda: made.get_subscription_count() > 0, WAIT_S, f"the console at {topic.name}")
        return made

    facts = ros_side.facts
    state, joints, goal = (publisher(topic) for topic in (topics.BRIDGE_STATE, topics.TWIN_JOINTS, topics.TRAVEL_GOAL))
    way, panel = publisher(topics.TRAVEL_PATH), publisher(topics.TRIAL_PANEL)

    joints.publish(PoseArray(poses=[Pose()] * 13))
    wait_until(lambda: len(facts.joints_m) == 13, WAIT_S, "the joints")
    lost = Pose()
    lost.position.x = math.nan
    joints.publish(PoseArray(poses=[Pose()] * 12 + [lost]))
    wait_until(lambda: len(facts.joints_m) == 0, WAIT_S, "joints that are none")

    nowhere, far = PoseStamped(pose=lost), PoseStamped()
    far.pose.position.y = math.inf
    way.publish(Path(poses=[PoseStamped(), nowhere, far]))
    wait_until(lambda: len(facts.way_m) == 1, WAIT_S, "the part of the way that is one")
    goal.publish(PoseStamped())
    wait_until(lambda: facts.goal_m is not None, WAIT_S, "the goal")
    goal.publish(nowhere)
    wait_until(lambda: facts.goal_m is None, WAIT_S, "a goal that is none")

    panel.publish(String(data=json.dumps({"question": "x" * 2_000_000})))
    panel.publish(String(data='{"question": "\\u001b[2Jgo?", "done": NaN, "keys": [["y", "yes: \\u001b[2Jsuccess"], "n"]}'))
    wait_until(lambda: facts.trial, WAIT_S, "the panel")
    assert facts.trial == {"question": "[2Jgo?", "done": None, "keys": [["y", "yes: [2Jsuccess"]]}

    reason, holder = "\x1b]0;x\x07" + "r" * 10_000, "me\r\n" * 1000
    told = BridgeState(state="AR\x1bMED", reason=reason, lease_holder=holder, duty_left_s=math.nan)
    told.header.stamp = operator.node.get_clock().now().to_msg()
    state.publish(told)
    wait_until(lambda: facts.state == "ARMED", WAIT_S, "the state")
    assert "\x1b" not in facts.reason + facts.holder
    assert len(facts.reason) <= 300
    assert len(facts.holder) <= 64
    json_of(document_of(facts, Selection(), 0.0))


class Losing:
    """A client whose first requests are lost, as those to a server that has not met it yet; DDS loses them by chance alone."""

    def __init__(self, lost):
        self.futures, self._lost = [], lost

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.futures.append(Future())
        if len(self.futures) > self._lost:
            self.futures[-1].set_result(Trigger.Response(success=True))
        return self.futures[-1]


def test_a_stop_that_was_lost_is_asked_again_and_silence_is_told(ros_side):
    told = Queue()
    ros_side._stop = Losing(2)
    ros_side.stop(lambda done, words: told.put((done, words)))
    done, words = told.get(timeout=WAIT_S)
    assert done, words
    assert len(ros_side._stop.futures) == 3
    ros_side._stop = Losing(10**6)
    ros_side.stop(lambda done, words: told.put((done, words)))
    assert told.get(timeout=WAIT_S) == (False, "NOT STOPPED: the bridge has not answered for 1 s; use the power switch")
    assert len(ros_side._stop.futures) > 1
    assert told.empty()
