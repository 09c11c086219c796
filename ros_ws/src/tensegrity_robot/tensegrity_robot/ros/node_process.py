# SPDX-License-Identifier: Apache-2.0
"""One node, one process: from the start to a clean end by a signal."""

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from sim_core.errors import SimError
from sim_core.printable import printable, replace_what_cannot_be_shown
from tensegrity_robot.ros.discovery import require_network, set_discovery
from tensegrity_robot.ros.errors import StartError

EndProcess = Callable[[int], None]
"""Asks the process to end with an exit code. May be called from any thread."""

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""Of timers that a simulated or corrected clock must not stop."""


def age_s() -> float:
    """Time since the system started this process, in s, to about 10 ms: what came before the first line of Python counts."""
    fields = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def own_context(domain: int | None = None) -> Context:
    """ROS in a program that is no node: a context of its own, and signals stay the program's. Raises StartError.

    Args: domain: None: the shell's, found as nodes find each other.
    """
    (set_discovery if domain is None else require_network)()
    context = Context()
    try:
        rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise StartError(_unstarted(error)) from error
    return context


def _unstarted(error: Exception) -> str:
    names = sorted(name for name in os.environ if name.startswith(("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "CYCLONEDDS_")))
    return f"ROS does not start: {printable(error)}; look at what is set: {', '.join(names)}"


def run(make_node: Callable[[EndProcess], Any], args: list[str] | None = None) -> int:
    """Make the node, spin it on a single-threaded executor until SIGINT, SIGTERM or `EndProcess`, end it; return the exit code.

    The executor has a thread of its own; the main thread only waits for the end. A signal therefore interrupts no callback, and a
    second one disturbs no clean-up. Beside rclpy's own methods the node has `halt`, which stops whatever moves at once, while
    callbacks may still run, and `close`, which lets go of files, ports and threads when none runs any more.
    """
    replace_what_cannot_be_shown()
    ends: SimpleQueue[int] = SimpleQueue()  # its put may be called from a signal handler
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ends.put(0))
    try:
        set_discovery()
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node(ends.put)
    except (StartError, SimError, rclpy_implementation.RCLError) as error:
        print(f"error: {_unstarted(error) if isinstance(error, RuntimeError) else error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            ends.put(0)
        except Exception:
            traceback.print_exc()
            ends.put(1)

    thread = threading.Thread(target=spin, name="executor", daemon=True)
    thread.start()
    code = ends.get()
    try:
        node.halt()
        executor.shutdown()
        thread.join(timeout=2.0)
    finally:
        node.close()
    node.destroy_node()
    rclpy.try_shutdown()
    for number in (signal.SIGINT, signal.SIGTERM):  # the interpreter's own end would make a late one deadly
        signal.signal(number, signal.SIG_IGN)
    return code
