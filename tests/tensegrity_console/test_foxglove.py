# SPDX-License-Identifier: Apache-2.0
"""The live stack for the Foxglove app: what is offered, what is taken, and what is not; by the bytes of its protocol."""

import os
import re
import signal
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.message_definitions import ShareSchemas
from tensegrity_console.access import MOST_UNSENT
from tensegrity_console.foxglove.foxglove_server import FoxgloveServer
from tensegrity_interfaces.msg import LeaseProof
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import wait_until
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_robot.ros import qos
from tensegrity_robot.ros.cdr import wire_bytes
from tests.tensegrity_console.foxglove_client import PROTOCOL, App
from tests.tensegrity_robot.conftest import compiled, domain
from tests.tensegrity_robot.stack.test_viewers import viewed_topics

__all__ = ["compiled", "domain"]
pytestmark = pytest.mark.ros
TOKEN = "a-token-of-tests"
NOTHING = b"\x00\x01\x00\x00"
"""An empty request as an app encodes it: the encapsulation alone."""


@pytest.fixture
def world(domain, monkeypatch):
    """A node that is the rest of the stack, and the calls and goals that came to it."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("rest_of_the_stack", context=context)
    node.came = []

    def answer(name):
        def callback(request, response):
            node.came.append(name)
            response.success, response.message = True, f"{name}: done"
            return response

        return callback

    for name in ("stop", "reset"):
        node.create_service(Trigger, name, answer(name))
    node.create_subscription(PoseStamped, "goal_pose", node.came.append, qos.STATES)
    spinner = Spinner(node, context)
    yield node
    spinner.close()
    context.try_shutdown()


@pytest.fixture
def opened(world):
    """Opens servers and apps, and closes them."""
    closing = []

    def server(commands=False, port=0, origins=()):
        one = FoxgloveServer(port, commands, TOKEN, origins)
        closing.append(one)
        return one

    def app(of):
        one = App(of.url)
        closing.append(one)
        return one

    yield server, app
    for one in reversed(closing):
        one.close()


def test_a_topic_comes_with_its_definition_and_a_late_viewer_is_told_the_latched_one_too(world, opened):
    server, app = opened
    latched = world.create_publisher(String, "words", qos.LATCHED)
    latched.publish(String(data="the last one"))
    served = server()
    for _ in range(2):
        viewer = app(served)
        viewer.subscribe("/words")
        assert viewer.first("/words").data == "the last one"


def test_a_topic_is_listened_to_only_while_somebody_looks(world, opened):
    server, app = opened
    publisher = world.create_publisher(String, "stream", qos.STATES)
    viewer = app(server())
    viewer.until(lambda: "/stream" in viewer.channels, "the topic")
    assert publisher.get_subscription_count() == 0
    looked_at = viewer.subscribe("/stream")
    wait_until(lambda: publisher.get_subscription_count() == 1, 10.0, "a subscription")
    publisher.publish(String(data="seen"))
    assert viewer.first("/stream").data == "seen"
    viewer.unsubscribe(looked_at)
    wait_until(lambda: publisher.get_subscription_count() == 0, 10.0, "its end")


def test_without_commands_only_the_stop_is_taken(world, opened):
    server, app = opened
    viewer = app(server())
    answer = deserialize_message(viewer.call("/stop", NOTHING), Trigger.Response)
    assert (answer.success, answer.message) == (True, "stop: done")
    assert set(viewer.services) == {"/stop"}
    assert "clientPublish" not in viewer.info["capabilities"]
    viewer.publish("/goal_pose", "geometry_msgs/msg/PoseStamped", wire_bytes(PoseStamped()))
    viewer.call("/stop", NOTHING)  # what was sent before has been dealt with
    assert world.came == ["stop", "stop"]


def test_with_commands_goals_pass_and_the_other_services_are_there(world, opened):
    server, app = opened
    viewer = app(server(commands=True))
    viewer.call("/reset", NOTHING)
    assert world.came == ["reset"]
    assert set(viewer.services) == {"/stop", "/reset", "/arm", "/disarm"}
    goal = PoseStamped()
    goal.header.frame_id, goal.pose.position.x = "odom", 0.6
    wait_until(lambda: world.count_publishers("goal_pose") == 1, 10.0, "the publisher of goals")
    viewer.publish("/goal_pose", "geometry_msgs/PoseStamped", wire_bytes(goal))
    wait_until(lambda: len(world.came) == 2, 10.0, "the goal")
    assert world.came[1].pose == goal.pose
    assert world.came[1].header.frame_id == "odom"
    assert world.came[1].header.stamp.sec > 0, "a panel's text holds no time: it was asked for when it came"


@pytest.mark.parametrize(
    ("topic", "schema", "data", "told"),
    [
        ("/bridge/lease", "tensegrity_interfaces/msg/LeaseProof", NOTHING, "only goals on /goal_pose are taken"),
        (
            "/goal_pose",
            "geometry_msgs/msg/Twist",
            NOTHING,
            "/goal_pose is geometry_msgs/PoseStamped in cdr, not geometry_msgs/Twist in cdr",
        ),
        ("/goal_pose", "geometry_msgs/msg/PoseStamped", b"\x00\x01", "no pose came on /goal_pose"),
    ],
)
def test_whatever_else_an_app_publishes_is_refused_with_a_word(world, opened, topic, schema, data, told):
    server, app = opened
    viewer = app(server(commands=True))
    viewer.publish(topic, schema, data)
    viewer.until(lambda: any(told in words for words in viewer.statuses), "a warning")
    assert world.came == []


@pytest.mark.parametrize(
    ("path", "origin", "host"),
    [
        ("/", None, None),
        ("/?token=" + TOKEN, None, None),
        ("/a-token-of-guesses", None, None),
        (f"/{TOKEN}/", "http://127.0.0.1:1", None),  # another user's page, at another port of the same host
        (f"/{TOKEN}/", "https://elsewhere.example", None),
        (f"/{TOKEN}/", "null", None),
        (f"/{TOKEN}/", None, "rebound.example"),
        (f"/{TOKEN}/", "http://rebound.example", "rebound.example"),
    ],
)
def test_who_was_not_let_in_reads_nothing_and_stops_nothing(world, opened, path, origin, host):
    server, _ = opened
    place = urlsplit(server(commands=True).url)
    with pytest.raises(InvalidStatus) as refused:
        connect(
            f"ws://{host or place.hostname}:{place.port}{path}",
            sock=socket.create_connection((place.hostname, place.port)),
            origin=origin,
            subprotocols=[PROTOCOL],
        )
    assert refused.value.response.status_code == 403
    assert "Access-Control-Allow-Origin" not in refused.value.response.headers
    assert world.came == []


@pytest.mark.parametrize("origin", ["https://app.foxglove.dev", "file://", "http://localhost:8123", None])
def test_foxglove_s_own_pages_and_those_that_were_named_are_let_in_by_the_address(world, opened, origin):
    server, _ = opened
    app = App(server(origins=("http://localhost:8123",)).url, origin)
    app.until(lambda: "/stop" in app.services, "the services")
    app.close()


def test_a_lease_leaves_on_no_topic_and_in_no_answer(world, opened):
    server, app = opened

    def grant(request, response):
        response.success, response.lease, response.message = True, "the right to command", "granted"
        return response

    world.create_service(Arm, "arm", grant)
    world.create_publisher(LeaseProof, "bridge/lease", qos.STATES)
    world.create_publisher(String, "words", qos.STATES)
    viewer = app(server(commands=True))
    answer = deserialize_message(viewer.call("/arm", wire_bytes(Arm.Request())), Arm.Response)
    assert (answer.success, answer.message, answer.lease) == (True, "granted", "")
    viewer.until(lambda: "/words" in viewer.channels, "a topic that is offered")
    assert "/bridge/lease" not in viewer.channels


@pytest.mark.slow
def test_an_app_that_reads_nothing_is_let_go_and_the_others_go_on(world, opened, monkeypatch):
    """Without bounds the server would keep for it whatever is published."""
    monkeypatch.setattr("tensegrity_console.access.PING_S", 1.0)
    server, app = opened
    publisher = world.create_publisher(String, "stream", qos.STATES)
    served = server()
    deaf, viewer = app(served), app(served)
    for one in (deaf, viewer):
        one.subscribe("/stream")
    wait_until(lambda: publisher.get_subscription_count() == 1, 10.0, "a subscription")
    large = String(data="x" * 500_000)
    kept = lambda: max((one.unsent for one in served._hub.apps), default=0)  # noqa: E731
    peak = 0
    for _ in range(60):
        publisher.publish(large)
        assert viewer.newest("/stream").data == large.data
        peak = max(peak, kept())
    assert 0 < peak < MOST_UNSENT + 1_000_000
    answer = deserialize_message(viewer.call("/stop", NOTHING), Trigger.Response)
    assert answer.success
    wait_until(lambda: len(served._hub.apps) == 1, 60.0, "the end of the one that does not read")


def test_what_is_not_the_protocol_is_refused_with_a_word_and_ends_nothing(world, opened):
    server, app = opened
    viewer = app(server(commands=True))
    for data in ("{", "[]", '{"op": "subscribe", "subscriptions": 1}', "[" * 5000, b"", b"\x02\x01", b"\x01\x00", b"\xff"):
        viewer.say_raw(data)
    assert deserialize_message(viewer.call("/stop", NOTHING), Trigger.Response).success
    assert world.came == ["stop"]


def test_a_service_that_nobody_offers_says_so(world, opened):
    server, app = opened
    viewer = app(server(commands=True))
    assert "nobody offers /disarm: is the stack running?" in viewer.call("/disarm", NOTHING)


def test_a_taken_port_is_one_line(world, opened):
    server, _ = opened
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(StackError, match="give another --port"):
        server(port=taken.getsockname()[1])


def test_definitions_of_services_come_in_halves():
    request, response = ShareSchemas().service_texts("std_srvs/srv/Trigger")
    assert request.strip() == ""
    assert [line.split("#")[0].split() for line in response.splitlines()] == [["bool", "success"], ["string", "message"]]


@pytest.mark.slow
def test_the_command_serves_a_virtual_robot_that_can_be_armed_and_stopped(tmp_path, compiled, domain):
    """The command itself, with a whole stack: all that the layout shows is offered, and its buttons work."""
    words = ["foxglove", "--virtual", "--commands", "--port", "0", "--bags", str(tmp_path), "--time-scale", "4"]
    process = subprocess.Popen(
        [sys.executable, "-m", "sixstrut_cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"},
    )
    try:
        url = layout = None
        for line in process.stdout:
            if found := re.search(r"(ws://\S+) and the layout (\S+)", line):
                url, layout = found.groups()
                break
        assert url, "it ended"
        assert os.path.exists(layout)
        app = App(url)
        shown = viewed_topics() - {"/rehearsal", "/travel/path", "/travel/goal"}  # published before a roll, and on a travel, only
        app.until(lambda: shown <= set(app.channels), "all that the layout shows", 60.0)
        app.subscribe("/bridge/state")
        app.subscribe("/twin/markers")
        assert {marker.header.frame_id for marker in app.newest("/twin/markers").markers} == {"odom"}
        app.until(lambda: "nobody offers" not in str(app.call("/arm", wire_bytes(Arm.Request()))), "the planner", 60.0)
        assert "lifted" in refused(app)
        armed = deserialize_message(app.call("/arm", wire_bytes(Arm.Request(lifted_and_clear=True))), Arm.Response)
        assert armed.success, armed.message
        app.until(lambda: app.newest("/bridge/state").state == "ARMED", "homing's end", 60.0)
        stopped = deserialize_message(app.call("/stop", NOTHING), Trigger.Response)
        assert stopped.success, stopped.message
        app.until(lambda: app.newest("/bridge/state").state == "FAULT", "the stop", 60.0)
        app.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0
    finally:
        process.kill()
        process.wait()
    (bag,) = tmp_path.glob("session_*/")
    session = read_session(bag)
    assert any(session.of("twin/markers")), "a bag shows the robot in a viewer"
    assert "FAULT" in {state.state for state in session.of("bridge/state")}


def refused(app):
    """What arming says without the operator's word."""
    answer = deserialize_message(app.call("/arm", wire_bytes(Arm.Request())), Arm.Response)
    assert not answer.success
    return answer.message
