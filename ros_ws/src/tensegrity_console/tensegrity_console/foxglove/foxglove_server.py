# SPDX-License-Identifier: Apache-2.0
"""The running stack at a WebSocket of this machine, for the Foxglove app: what `foxglove_bridge` does where ROS is installed.

Every topic is offered with its definition, and subscribed to only while somebody looks. The address holds a secret; who has it may
look and stop, and with `commands` also send goals, arm, disarm and reset. No lease leaves it.
"""

import asyncio
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from hardware_bridge.errors import SchemaError
from hardware_bridge.recording.message_definitions import ShareSchemas
from sim_core.printable import printable
from tensegrity_console.access import LOOPBACK, Gate, address
from tensegrity_console.foxglove.foxglove_protocol import ENCODING, Hub, Service, schema
from tensegrity_interfaces.srv import Arm, Disarm
from tensegrity_lab.errors import ConsoleError, StackError
from tensegrity_lab.stack.message_types import message_class
from tensegrity_lab.stack.processes import Stack
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_lab.terminal.leaving import uninterrupted
from tensegrity_robot.ros.cdr import wire_bytes
from tensegrity_robot.ros.node_process import own_context
from tensegrity_robot.ros.topics import GOAL_POSE, LEASE

STOP, STOP_AGAIN_S = "stop", 0.25
COMMANDS: dict[str, Any] = {"reset": Trigger, "arm": Arm, "disarm": Disarm}
APPS = ("https://app.foxglove.dev", "file://")
"""Origins of Foxglove's own app, in a browser and installed: they need the secret like everybody."""
HIDDEN = "/_"
"""Of an action's inner topics."""
MOST_TOPICS = 500
DISCOVER_S = 0.5
ATTEND_S = 0.1
DEPTH = 100
FOUND_LIMIT_S = 2.0
"""For a service that has just come up, or this node."""
ANSWER_LIMIT_S = 5.0
LOOK_S, AGAIN_S = 0.5, 0.02
ARM_LIMIT_S = 40.0
"""A bridge just started loads its judge of shapes before it answers."""


def layout() -> Path:
    """The shipped layout for a live stack."""
    from ament_index_python.packages import get_package_share_directory

    return (Path(get_package_share_directory("tensegrity_robot")) / "foxglove" / "tensegrity.json").resolve()


def wait_for_end(processes: Stack | None) -> None:
    """Until SIGINT or SIGTERM. Raises StackError: a process of the stack died."""
    with uninterrupted() as came:
        while not came:
            if processes is not None:
                processes.require_alive()
            time.sleep(LOOK_S)


class _Offered(NamedTuple):
    """A topic that apps can see."""

    channel: int
    kind: Any
    latched: bool


class FoxgloveServer:
    """A socket at 127.0.0.1 that speaks Foxglove's protocol, and two nodes: one for the services, so that no topic delays a stop.

    Args:
        port: TCP; 0: any free one.
        commands: also take goals (`goal_pose`), reset, arm and disarm.
        token: what the address holds.
        origins: of web pages that may connect, beside Foxglove's own app.

    Raises StackError: the port is taken. `url`: where apps connect.
    """

    def __init__(self, port: int, commands: bool, token: str, origins: tuple[str, ...] = ()):
        self._schemas = ShareSchemas()
        self._lock = threading.Lock()
        self._joined: set[str] = set()
        self._offered: dict[str, _Offered] = {}
        self._unknown: set[str] = set()
        self._heard: dict[str, Subscription] = {}
        self._context = own_context()
        self._node = Node("foxglove", context=self._context)
        asking = Node("foxglove_calls", context=self._context)
        self._goal_topic = self._node.resolve_topic_name(GOAL_POSE.name)
        self._goal = GOAL_POSE.publisher(self._node) if commands else None
        kinds = {STOP: Trigger, **(COMMANDS if commands else {})}
        services = [self._service(asking, name, kind) for name, kind in kinds.items()]
        try:
            self._hub = Hub(port, Gate(token, True, (*APPS, *origins)), services, commands, self._looked, self._published)
        except ConsoleError as error:
            self._context.try_shutdown()
            raise StackError(str(error)) from error
        self.url = address("ws", LOOPBACK[0], self._hub.port, token)
        self._node.create_timer(DISCOVER_S, self._discover)
        self._node.create_timer(ATTEND_S, self._attend)
        self._spinners = [Spinner(self._node, self._context), Spinner(asking, self._context)]

    def close(self) -> None:
        """Let the app go, and leave ROS."""
        self._hub.close()
        for spinner in self._spinners:
            spinner.close()
        self._context.try_shutdown()

    # ---- topics -----------------------------------------------------------------------------------------------------

    def _discover(self) -> None:
        """Offer what is new."""
        for topic, types in self._node.get_topic_names_and_types():
            known = topic in self._offered or topic in self._unknown or len(self._offered) + len(self._unknown) >= MOST_TOPICS
            if not known and HIDDEN not in topic and types[0] != LEASE.type_name:  # its proofs are the bridge's business
                self._offer(topic, types[0])

    def _attend(self) -> None:
        """Listen to what is looked at, and to nothing else."""
        with self._lock:
            joined, self._joined = self._joined, set()
        for topic, offered in self._offered.items():
            watched = self._hub.watched(offered.channel)
            again = watched and offered.latched and topic in joined  # so that who looks later is told the last one, too
            if topic in self._heard and (again or not watched):
                self._node.destroy_subscription(self._heard.pop(topic))
            if watched and topic not in self._heard:
                self._heard[topic] = self._listen(topic, offered)

    def _offer(self, topic: str, type_name: str) -> None:
        publishers = self._node.get_publishers_info_by_topic(topic)
        if not publishers:
            return
        try:
            text = self._schemas.schema_text(type_name)
            kind = message_class(type_name)
        except (SchemaError, StackError) as error:
            self._unknown.add(topic)
            self._node.get_logger().warning(f"{topic} is not shown: {error}")
            return
        latched = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in publishers)
        self._offered[topic] = _Offered(self._hub.offer(topic, schema(type_name, text)), kind, latched)

    def _listen(self, topic: str, offered: _Offered) -> Subscription:
        profile = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        if offered.latched:
            profile = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)

        def tell(data: bytes) -> None:
            self._hub.tell(offered.channel, self._node.get_clock().now().nanoseconds, data)

        return self._node.create_subscription(offered.kind, topic, tell, profile, raw=True)

    def _looked(self, topic: str) -> None:
        """An app begins to look; in the server's thread."""
        with self._lock:
            self._joined.add(topic)

    # ---- services ---------------------------------------------------------------------------------------------------

    def _service(self, node: Node, name: str, kind: Any) -> Service:
        client, full_name = node.create_client(kind, name), node.resolve_service_name(name)
        type_name = f"{kind.__module__.split('.')[0]}/srv/{kind.__name__}"
        texts = zip(("Request", "Response"), self._schemas.service_texts(type_name), strict=True)
        halves = {half.lower(): schema(f"{type_name}_{half}", text) for half, text in texts}
        limit_s = ARM_LIMIT_S if kind is Arm else ANSWER_LIMIT_S

        async def call(payload: bytes) -> bytes:
            until = time.monotonic() + FOUND_LIMIT_S
            while not client.service_is_ready():
                if time.monotonic() > until:
                    raise RuntimeError(f"nobody offers {full_name}: is the stack running?")
                await asyncio.sleep(AGAIN_S)
            empty = not kind.Request.get_fields_and_field_types()  # an app sends no byte for it, ROS expects one
            asked = kind.Request() if empty else deserialize_message(payload, kind.Request)
            again_s = STOP_AGAIN_S if name == STOP else limit_s
            response = await _answered(client, asked, full_name, limit_s, again_s)
            if kind is Arm:
                response.lease = ""  # the right to command goes to nobody out here
            return wire_bytes(response)

        return Service({"name": full_name, "type": type_name} | halves, call, urgent=name == STOP)

    # ---- goals ------------------------------------------------------------------------------------------------------

    def _published(self, topic: str, type_name: str, encoding: str, data: bytes) -> str:
        """A goal is passed on; the traveller judges it. Everything else is not taken: why. In the server's thread."""
        why_not = self._pass_on(topic, type_name.replace("/msg/", "/"), encoding, data)
        if why_not:
            self._node.get_logger().warning(why_not)
        return why_not

    def _pass_on(self, topic: str, type_name: str, encoding: str, data: bytes) -> str:
        if self._goal is None or topic != self._goal_topic:
            return f"only goals on {self._goal_topic} are taken{'' if self._goal else ', with --commands'}; nothing was done"
        if type_name != "geometry_msgs/PoseStamped" or encoding != ENCODING:
            return printable(f"{self._goal_topic} is geometry_msgs/PoseStamped in {ENCODING}, not {type_name} in {encoding}")
        try:
            goal = deserialize_message(data, PoseStamped)
        except Exception as error:  # whatever a type support says of bytes that are no pose
            return printable(f"no pose came on {self._goal_topic}: {error}")
        if goal.header.stamp.sec == 0:  # a panel sends what stands in its text; it was asked for now
            goal.header.stamp = self._node.get_clock().now().to_msg()
        self._goal.publish(goal)
        return ""


async def _answered(client: Any, asked: Any, name: str, limit_s: float, again_s: float) -> Any:
    """A service's response, asked for every `again_s`: a request to a server not met yet is lost. Raises RuntimeError."""
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[Any] = loop.create_future()
    futures: list[Any] = []
    end_s = loop.time() + limit_s

    def settle(done: Any) -> None:
        if not answer.done():
            answer.set_result(done.result())

    while not answer.done() and (left_s := end_s - loop.time()) > 0.0:
        futures.append(client.call_async(asked))
        futures[-1].add_done_callback(lambda done: loop.call_soon_threadsafe(settle, done))
        await asyncio.wait([answer], timeout=min(again_s, left_s))
    for future in futures:
        if not future.done():
            client.remove_pending_request(future)
    if not answer.done():
        raise RuntimeError(f"{name} did not answer within {limit_s:g} s")
    return answer.result()
