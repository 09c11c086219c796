# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into ROS, where rosbag2 is not installed: what the bridge told, under its live names, for a twin and for viewers.

Only what the bridge *told* is played. Nothing of it is a command, and while a bridge lives nothing is played at all.
"""

import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.node import Node

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_reader import Bag, Recorded, Session, read_bag
from sim_core.files.places import temporary_parent
from sim_core.printable import printable
from sim_core.twin.follower import MOST_TIME_SCALE
from tensegrity_interfaces.msg import TwinState
from tensegrity_lab.bags.replay import events_of, model_of, start_of
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.message_types import message_class
from tensegrity_lab.stack.processes import Stack, wait_until
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_robot.ros.cdr import wire_bytes
from tensegrity_robot.ros.node_process import own_context
from tensegrity_robot.ros.topics import TOPICS, TWIN_STATE

TOLD = {topic.name: topic.profile for topic in TOPICS if topic.told_by == "bridge" and not topic.name.startswith("/")}
"""Topics that are played. Not the twin's: it makes its own again."""
STREAM = ("bridge/struts_sent", "bridge/face")
MOST_PAUSE_S = 600.0
"""Recorded time in which nothing was told, such as while a link was lost, beyond which playing goes on."""
LOOK_S = 3.0
"""How long a living bridge may take to be found."""
DISCOVERY_LIMIT_S = 30.0


class Played(NamedTuple):
    """What was played, and where the twin then stood; twin None: none was started."""

    messages: int
    twin: TwinState | None


def play(bag: Path, rate: float, twin: bool, told: Callable[[float, float], None] = lambda done_s, total_s: None) -> Played:
    """Play a bag to its end.

    Args:
        bag: its file.
        rate: recorded seconds per second.
        twin: start a twin that follows.
        told: called with the seconds played, and of the whole bag.

    Raises:
        BagError, ReplayError: the bag cannot be read, or be a bridge's.
        StackError: a bridge lives, or the twin does not come up.
    """
    read = read_bag(bag, topics=(*TOLD, "twin/state"))
    session = read.session()
    types = _types(read)
    first_seq, start = start_of(session)
    due = _due(session, first_seq)
    if twin:
        session.require(STREAM[0])
    rate = min(rate, MOST_TIME_SCALE / max(1.0, _time_scale(session)))
    with ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="sixstrut-play-", dir=temporary_parent())))
        context = own_context()
        closing.callback(context.try_shutdown)
        spinner = Spinner(Node("sixstrut_player", context=context), context)
        closing.callback(spinner.close)
        node = spinner.node
        _require_no_bridge(node)
        publishers = {name: node.create_publisher(message_class(type_name), name, TOLD[name]) for name, type_name in types.items()}
        if not twin:
            return Played(_publish(due, publishers, types, rate, told), None)
        parameters: dict[str, Any] = {"start_face": start}
        if "prototype.yaml" in session.attachments:
            (folder / "prototype.yaml").write_bytes(session.attachments["prototype.yaml"])
            parameters["prototype_file"] = folder / "prototype.yaml"
        stack = closing.enter_context(Stack(folder / "logs"))
        newest: deque[TwinState] = deque(maxlen=1)
        TWIN_STATE.subscribe(node, lambda state: newest.append(state))
        stack.node("twin", **parameters)
        streams = [publishers[name] for name in STREAM if name in publishers]
        met = lambda: all(stream.get_subscription_count() for stream in streams)  # noqa: E731
        wait_until(met, DISCOVERY_LIMIT_S, "the twin", stack)
        wait_until(lambda: newest, DISCOVERY_LIMIT_S, "the twin's first state", stack)
        count = _publish(due, publishers, types, rate, told)
        last = max((m.message.seq for m in due if m.topic in STREAM), default=0)
        wait_until(lambda: newest[0].last_seq == last, DISCOVERY_LIMIT_S, "the twin's last state", stack)
        return Played(count, newest[0])


def _require_no_bridge(node: Node) -> None:
    """Two streams at once would be nonsense to every listener. Raises StackError."""
    end = time.monotonic() + LOOK_S
    while time.monotonic() < end:
        if node.count_publishers("bridge/struts_sent"):
            raise StackError("a bridge is running: nothing is played beside it; end it, or play in another ROS_DOMAIN_ID")
        time.sleep(0.02)


def _live_name(topic: str) -> str:
    """The name that was recorded, without any namespace."""
    return "/".join(topic.split("/")[-2:])


def _types(bag: Bag) -> dict[str, str]:
    return {_live_name(message.topic): message.type_name for message in bag.messages if _live_name(message.topic) in TOLD}


def _time_scale(session: Session) -> float:
    """Robot seconds per second when it was recorded."""
    try:
        return float(session.metadata.get("session", {}).get("time_scale", "1"))
    except ValueError:
        return 1.0


def _due(session: Session, first_seq: int) -> list[Recorded]:
    """What is played, in the order of recording. The stream begins where the recorded twin's did, so that its states are the same.

    Raises:
        StackError: nothing is.
        ReplayError: no bridge can have told it.
    """
    found = [recorded._replace(topic=_live_name(name)) for name, all_ in session.messages.items() for recorded in all_]
    due = sorted((one for one in found if one.topic in TOLD), key=lambda one: one.log_time_ns)
    due = [one for one in due if one.topic not in STREAM or one.message.seq >= first_seq]
    if not due:
        raise StackError(f"{session.path} holds nothing that a bridge told: there is nothing to play")
    if any(one.topic == STREAM[0] for one in due):
        events_of(session, model_of(session).prototype.strut_length_m)
    return due


def _publish(
    due: Sequence[Recorded], publishers: dict[str, Any], types: dict[str, str], rate: float, told: Callable[[float, float], None]
) -> int:
    """Everything at its time, but no pause longer than MOST_PAUSE_S; each as today's type has it: old bags know fewer fields."""
    times_s = [0.0]
    for before, one in pairwise(due):
        times_s.append(times_s[-1] + min(MOST_PAUSE_S, 1e-9 * (one.log_time_ns - before.log_time_ns)))
    began = time.monotonic()
    for at_s, one in zip(times_s, due, strict=True):
        try:
            data = wire_bytes(filled(message_class(types[one.topic]), one.message))
        except (AssertionError, TypeError, ValueError, OverflowError) as error:
            raise BagError(
                f"a message of {one.topic} is none of today's {types[one.topic]}: {printable(str(error), 80)}"
            ) from error
        wait_s = began + at_s / rate - time.monotonic()
        if wait_s > 0.0:
            time.sleep(wait_s)
        publishers[one.topic].publish(data)
        told(at_s, times_s[-1])
    return len(due)


def filled(kind: Any, decoded: Any) -> Any:
    """A message of a class with the fields that a decoded one has; the others have their defaults."""
    message = kind()
    for name, text in kind.get_fields_and_field_types().items():
        if not hasattr(decoded, name):
            continue
        value, element = getattr(decoded, name), text.removeprefix("sequence<").rstrip(">").split(",")[0].split("[")[0]
        if "/" in element:
            package, _, short = element.partition("/")
            part = message_class(f"{package}/msg/{short}")
            value = [filled(part, item) for item in value] if isinstance(value, list) else filled(part, value)
        setattr(message, name, value)
    return message
