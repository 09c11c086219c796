"""Plays a bag into ROS, where rosbag2 is not installed: what the bridge told, under its live names, for a twin and for viewers.

Only what the bridge *told* is played. Nothing of it is a command, and while a bridge lives nothing is played at all.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from mcap.reader import make_reader
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from hardware_bridge.bag_reader import read_session
from hardware_bridge.recorder import PREFIX
from sixstrut_cli.errors import StackError
from sixstrut_cli.ros_types import message_class
from sixstrut_cli.stack import Stack, executable, ros_arguments, wait_until
from tensegrity_interfaces.msg import TwinState
from tensegrity_robot import qos
from tensegrity_robot.discovery import discovery_changes, loopback_profile

TOLD: dict[str, QoSProfile] = {
    "bridge/struts_sent": qos.STREAM,
    "bridge/face": qos.FACES,
    "bridge/state": qos.LATCHED,
    "bridge/joint_states": qos.STATES,
    "bridge/observed_joints": qos.STATES,
    "bridge/asked": qos.STATES,
    "bridge/trial": qos.FACES,
}
"""Topics that are played. Not the twin's: it makes its own again."""
STREAM = ("bridge/struts_sent", "bridge/face")
LOOK_S = 3.0
"""How long a living bridge may take to be found."""
DISCOVERY_LIMIT_S = 30.0


class Played(NamedTuple):
    """What was played, and where the twin then stood; twin None: none was started."""

    messages: int
    twin: TwinState | None


class _Message(NamedTuple):
    topic: str
    type_name: str
    data: bytes
    log_time_ns: int


def play(bag: Path, rate: float, twin: bool, told: Callable[[float, float], None] = lambda done_s, total_s: None) -> Played:
    """Play a bag to its end.

    Args:
        rate: recorded seconds per second. twin: start one that follows.
        told: called with the seconds played, and of the whole bag.

    Raises:
        BagError: the bag cannot be read. StackError: a bridge lives, or the twin does not come up.
    """
    session = read_session(bag)
    states = [m for m in session.of("twin/state") if m.last_seq > 0]
    first_seq = states[0].first_seq if states else 0
    before = [m.face for m in session.of("bridge/face") if m.seq < first_seq and m.face]
    start = (before or [m.face for m in states if m.face] or ["TC6"])[-1 if before else 0]
    os.environ.update(discovery_changes(os.environ, loopback_profile()))
    with ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="sixstrut-play-")))
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        closing.callback(rclpy.try_shutdown)
        node = Node("sixstrut_player")
        closing.callback(node.destroy_node)
        _require_no_bridge(node)
        publishers = {
            name: node.create_publisher(message_class(type_name), name, TOLD[name]) for name, type_name in _types(bag).items()
        }
        if not twin:
            return Played(_publish(bag, publishers, rate, first_seq, told), None)
        parameters: dict[str, object] = {"start_face": start}
        if "prototype.yaml" in session.attachments:
            (folder / "prototype.yaml").write_bytes(session.attachments["prototype.yaml"])
            parameters["prototype_file"] = folder / "prototype.yaml"
        stack = closing.enter_context(Stack(folder / "logs"))
        newest: list[TwinState] = []
        node.create_subscription(TwinState, "twin/state", lambda message: newest.__setitem__(slice(None), [message]), qos.STATES)
        _spin(node, closing)
        stack.start("twin", [executable("tensegrity_robot", "twin"), *ros_arguments(parameters)])
        for name in STREAM:
            if name in publishers:
                ready = publishers[name]
                wait_until(lambda ready=ready: ready.get_subscription_count() > 0, DISCOVERY_LIMIT_S, "the twin", stack)  # type: ignore[misc]
        wait_until(lambda: newest, DISCOVERY_LIMIT_S, "the twin's first state", stack)
        count = _publish(bag, publishers, rate, first_seq, told)
        last = max((m.seq for name in STREAM for m in session.of(name)), default=0)
        wait_until(lambda: newest[0].last_seq == last, DISCOVERY_LIMIT_S, "the twin's last state", stack)
        return Played(count, newest[0])


def _require_no_bridge(node: Node) -> None:
    """Two streams at once would be nonsense to every listener. Raises StackError."""
    end = time.monotonic() + LOOK_S
    while time.monotonic() < end:
        if node.count_publishers("bridge/struts_sent"):
            raise StackError("a bridge is running: nothing is played beside it; end it, or play in another ROS_DOMAIN_ID")
        time.sleep(0.02)


def _spin(node: Node, closing: ExitStack) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    closing.callback(thread.join, 5.0)
    closing.callback(executor.shutdown)


def _messages(bag: Path) -> Iterator[_Message]:
    """What the bridge told, in the order of recording."""
    with bag.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            topic = _live_name(channel.topic)
            if topic in TOLD and schema is not None:
                yield _Message(topic, schema.name, message.data, message.log_time)


def _live_name(topic: str) -> str:
    """The name that was recorded, without the prefix and any namespace."""
    words = topic.removeprefix(PREFIX).strip("/").split("/")
    return "/".join(words[-2:])


def _types(bag: Path) -> dict[str, str]:
    return {message.topic: message.type_name for message in _messages(bag)}


def _publish(bag: Path, publishers: dict[str, Any], rate: float, first_seq: int, told: Callable[[float, float], None]) -> int:
    """Everything at its time. The stream begins where the recorded twin's did, so that its states come out the same."""
    from rclpy.serialization import deserialize_message

    messages = list(_messages(bag))
    if not messages:
        raise StackError(f"{bag} holds nothing that a bridge told: there is nothing to play")
    first_ns, last_ns = messages[0].log_time_ns, messages[-1].log_time_ns
    began, count = time.monotonic(), 0
    for message in messages:
        if message.topic in STREAM and deserialize_message(message.data, message_class(message.type_name)).seq < first_seq:
            continue
        at_s = (message.log_time_ns - first_ns) * 1e-9
        wait_s = began + at_s / rate - time.monotonic()
        if wait_s > 0.0:
            time.sleep(wait_s)
        publishers[message.topic].publish(message.data)
        count += 1
        told(at_s, (last_ns - first_ns) * 1e-9)
    return count
