"""The running stack at a WebSocket of this machine, for the Foxglove app: what `foxglove_bridge` does where ROS is installed.

Every topic is offered with its definition, and subscribed to only while somebody looks. Any program on this machine may open the
socket, also a page in a browser, so without `commands` it takes one thing only: the stop.
"""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any, NamedTuple

import foxglove
import rclpy
from foxglove import Channel, MessageSchema, Schema, Service, ServiceRequest, ServiceSchema
from foxglove.websocket import Capability, ChannelView, Client, ClientChannel, ServerListener, StatusLevel
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from hardware_bridge.errors import SchemaError
from hardware_bridge.schemas import ShareSchemas
from sixstrut_cli.errors import StackError
from sixstrut_cli.ros_types import message_class
from sixstrut_cli.spinner import Spinner
from sixstrut_cli.stack import Stack
from tensegrity_interfaces.srv import Arm, Disarm
from tensegrity_robot import qos
from tensegrity_robot.cdr import wire_bytes
from tensegrity_robot.discovery import discovery_changes, loopback_profile

HOST = "127.0.0.1"
"""Always: the socket knows no password."""
ENCODING = "cdr"
GOAL = "goal_pose"
STOP = "stop"
COMMANDS: dict[str, Any] = {"reset": Trigger, "arm": Arm, "disarm": Disarm}
HIDDEN = "/_"
"""Of an action's inner topics."""
DISCOVER_S = 0.5
ATTEND_S = 0.1
DEPTH = 100
FOUND_LIMIT_S = 2.0
"""For a service that has just come up, or this node."""
ANSWER_LIMIT_S = 5.0
LOOK_S = 0.5
ARM_LIMIT_S = 40.0
"""A bridge just started loads its judge of shapes before it answers."""


def layout() -> Path:
    """The shipped layout for a live stack."""
    from ament_index_python.packages import get_package_share_directory

    path = Path(get_package_share_directory("tensegrity_robot")) / "foxglove" / "tensegrity.json"
    return path.resolve()


def wait_for_end(processes: Stack | None) -> None:
    """Until SIGINT or SIGTERM. Raises StackError: a process of the stack died."""
    ended = threading.Event()
    before = {number: signal.signal(number, lambda *_: ended.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        while not ended.wait(LOOK_S):
            if processes is not None:
                processes.require_alive()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Offered(NamedTuple):
    """A topic that the app can see."""

    channel: Channel
    kind: Any
    latched: bool


class FoxgloveServer(ServerListener):
    """A socket at 127.0.0.1 that speaks Foxglove's protocol, and two nodes: one for the services, so that no topic delays a stop.

    Args:
        port: TCP; 0: any free one.
        commands: also take goals (`goal_pose`), reset, arm and disarm.

    Raises:
        StackError: the port is taken.

    Attributes:
        url: to connect to.
    """

    def __init__(self, port: int, commands: bool):
        os.environ.update(discovery_changes(os.environ, loopback_profile()))
        self._schemas = ShareSchemas()
        self._lock = threading.Lock()
        self._joined: set[str] = set()
        self._goals: set[tuple[int, int]] = set()
        self._offered: dict[str, _Offered] = {}
        self._unknown: set[str] = set()
        self._heard: dict[str, Subscription] = {}
        self._foxglove = foxglove.Context()
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("foxglove", context=self._context)
        asking = Node("foxglove_calls", context=self._context)
        self._goal_topic = self._node.resolve_topic_name(GOAL)
        self._goal = self._node.create_publisher(PoseStamped, GOAL, qos.STATES) if commands else None
        kinds = {STOP: Trigger, **(COMMANDS if commands else {})}
        capabilities = [Capability.Services, *([Capability.ClientPublish] if commands else [])]
        try:
            self._server = foxglove.start_server(
                name="sixstrut",
                host=HOST,
                port=port,
                capabilities=capabilities,
                server_listener=self,
                supported_encodings=[ENCODING],
                services=[self._service(asking, name, kind) for name, kind in kinds.items()],
                context=self._foxglove,
            )
        except (OSError, RuntimeError) as error:
            rclpy.try_shutdown(context=self._context)
            raise StackError(f"cannot listen on {HOST}:{port} ({error}): give another --port") from error
        self.url = f"ws://{HOST}:{self._server.port}"
        self._node.create_timer(DISCOVER_S, self._discover)
        self._node.create_timer(ATTEND_S, self._attend)
        self._spinners = [Spinner(self._node, self._context), Spinner(asking, self._context)]

    def close(self) -> None:
        """Let the app go, and leave ROS."""
        self._server.stop()
        for spinner in self._spinners:
            spinner.close()
        rclpy.try_shutdown(context=self._context)

    # ---- topics -----------------------------------------------------------------------------------------------------

    def _discover(self) -> None:
        """Offer what is new."""
        for topic, types in self._node.get_topic_names_and_types():
            if topic not in self._offered and topic not in self._unknown and HIDDEN not in topic:
                self._offer(topic, types[0])

    def _attend(self) -> None:
        """Listen to what is looked at, and to nothing else."""
        with self._lock:
            joined, self._joined = self._joined, set()
        for topic, offered in self._offered.items():
            watched = offered.channel.has_sinks()
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
        schema = Schema(name=type_name, encoding="ros2msg", data=text.encode())
        latched = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in publishers)
        channel = Channel(topic, schema=schema, message_encoding=ENCODING, context=self._foxglove)
        self._offered[topic] = _Offered(channel, kind, latched)

    def _listen(self, topic: str, offered: _Offered) -> Subscription:
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if offered.latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if offered.latched else DurabilityPolicy.VOLATILE,
        )

        def tell(data: bytes) -> None:
            offered.channel.log(data, log_time=self._node.get_clock().now().nanoseconds)

        return self._node.create_subscription(offered.kind, topic, tell, profile, raw=True)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Somebody looks."""
        with self._lock:
            self._joined.add(channel.topic)

    # ---- services ---------------------------------------------------------------------------------------------------

    def _service(self, node: Node, name: str, kind: Any) -> Service:
        client, full_name = node.create_client(kind, name), node.resolve_service_name(name)
        type_name = f"{kind.__module__.split('.')[0]}/srv/{kind.__name__}"
        halves = zip(("Request", "Response"), self._schemas.service_texts(type_name), strict=True)
        request, response = (
            MessageSchema(encoding=ENCODING, schema=Schema(name=f"{type_name}_{half}", encoding="ros2msg", data=text.encode()))
            for half, text in halves
        )
        limit_s = ARM_LIMIT_S if kind is Arm else ANSWER_LIMIT_S

        def handle(call: ServiceRequest) -> bytes:
            if not client.wait_for_service(timeout_sec=FOUND_LIMIT_S):
                raise RuntimeError(f"nobody offers {full_name}: is the stack running?")
            empty = not kind.Request.get_fields_and_field_types()  # an app sends no byte for it, ROS expects one
            asked = kind.Request() if empty else deserialize_message(call.payload, kind.Request)
            answered = threading.Event()
            future = client.call_async(asked)
            future.add_done_callback(lambda _: answered.set())
            if not answered.wait(limit_s):
                client.remove_pending_request(future)
                raise RuntimeError(f"{full_name} did not answer within {limit_s:g} s")
            return wire_bytes(future.result())

        return Service(name=full_name, schema=ServiceSchema(type_name, request=request, response=response), handler=handle)

    # ---- goals ------------------------------------------------------------------------------------------------------

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        """An app wants to publish: only goals are taken."""
        kind = channel.schema_name.replace("/msg/", "/")
        if channel.topic == self._goal_topic and kind == "geometry_msgs/PoseStamped" and channel.encoding == ENCODING:
            self._goals.add((client.id, channel.id))
        elif channel.topic == self._goal_topic:
            self._complain(f"{channel.topic} is geometry_msgs/PoseStamped in {ENCODING}, not {kind} in {channel.encoding}")

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        """It will publish no more."""
        self._goals.discard((client.id, client_channel_id))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        """A goal, passed on; the traveller judges it."""
        if self._goal is None or (client.id, client_channel_id) not in self._goals:
            self._complain(f"only goals on {self._goal_topic} are taken; nothing was done")
            return
        try:
            goal = deserialize_message(data, PoseStamped)
        except Exception as error:  # whatever a type support says of bytes that are no pose
            self._complain(f"no pose came on {self._goal_topic}: {error}")
            return
        self._goal.publish(goal)

    def _complain(self, words: str) -> None:
        self._node.get_logger().warning(words)
        self._server.publish_status(words, StatusLevel.Warning)
