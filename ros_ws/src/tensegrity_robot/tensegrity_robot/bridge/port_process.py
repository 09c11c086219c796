# SPDX-License-Identifier: Apache-2.0
"""The process that owns the port and the frame timer: a `BridgeHost` for the bridge's node, and the service `stop`.

It subscribes to nothing and takes no message but a stop, which has no content: whatever the rest of the system sends, and however
long the node needs to read it, frames go out in time and stop is in force at once. The node starts it, and it ends with the node.
"""

import os
import pickle
import signal
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import NamedTuple

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from hardware_bridge.driver.bridge_host import MOST_BYTES, BridgeHost
from tensegrity_robot.ros.discovery import set_discovery

COMMAND = (sys.executable, "-m", "tensegrity_robot.bridge.port_process")

PRIORITY = -10
"""Nice value, for who may set it (root, or a limit `nice` in /etc/security/limits.conf)."""

STOPPED = "FAULT is latched until reset; if anything still moves, cut the servo supply"
NOTHING_MOVES = "there is no open port, nothing can move"


class StopService(NamedTuple):
    """Where stop is served: node, namespace and resolved service name; and ROS arguments of the process. Sent as a plain tuple."""

    node: str
    namespace: str
    service: str
    arguments: tuple[str, ...]


def main() -> int:
    """Serve the connection whose number is the last word of the command line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # at a terminal it reaches the whole group: the node says when this ends
    with suppress(OSError):  # where the system permits it: frames and stop come before whatever else keeps the computer busy
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    connection = Connection(int(sys.argv[-1]))
    os.set_inheritable(connection.fileno(), False)
    set_discovery()
    host = BridgeHost(connection)
    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=_end, args=(host,)).start())
    try:
        wanted = StopService(*pickle.loads(connection.recv_bytes(MOST_BYTES)))
    except (EOFError, OSError):
        return 0
    _serve_stop(wanted, host)
    host.serve()
    return 0


def _end(host: BridgeHost) -> None:
    host.end()
    os._exit(0)


def _serve_stop(wanted: StopService, host: BridgeHost) -> None:
    rclpy.init(args=list(wanted.arguments), signal_handler_options=SignalHandlerOptions.NO)
    node = Node(
        wanted.node,
        namespace=wanted.namespace,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],  # its requests are texts of any length
    )

    def stop(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, STOPPED if host.stop() else NOTHING_MOVES
        return response

    node.create_service(Trigger, wanted.service, stop)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    threading.Thread(target=spin, name="stop", daemon=True).start()


if __name__ == "__main__":
    os._exit(main())  # the bridge is closed; nothing that ROS still puts away may keep the port's process alive
