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
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError  # what `rclpy.init` raises has no public name
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from sim_core.errors import SimError
from sim_core.printable import printable, replace_what_cannot_be_shown
from tensegrity_robot.ros.discovery import require_network, set_discovery
from tensegrity_robot.ros.errors import StartError, require_known
from tensegrity_robot.ros.node_help import About

VARIABLES = tuple(
    f"SIXSTRUT_{name}" for name in ["BAGS", "DEBUG", "PYTHON", "ROOT", "STATE_DIR", "TEST_ALL", "TEST_MINUTES", "TOKEN"]
)
"""All that anything here reads."""

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
    except RCLError as error:
        raise StartError(_told(error)) from error
    return context


def _told(error: Exception) -> str:
    """One line, without places in ROS's source."""
    said = printable(str(error).partition(", at /")[0])
    if isinstance(error, UnknownROSArgsError):
        return f"ROS does not know the arguments {said}"
    if isinstance(error, RCLError):
        names = sorted(name for name in os.environ if name.startswith(("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "CYCLONEDDS_")))
        return f"ROS does not start: {said}; look at what is set: {', '.join(names)}"
    return str(error)


def run(make_node: Callable[[EndProcess], Any], about: About) -> int:
    """Make the node, spin it on a single-threaded executor until SIGINT, SIGTERM or `EndProcess`, end it; return the exit code.

    Where `--help` is asked for, it is printed instead, before ROS starts.

    The executor has a thread of its own; the main thread only waits for the end. A signal therefore interrupts no callback, and a
    second one disturbs no clean-up. Beside rclpy's own methods the node has `halt`, which stops whatever moves at once, while
    callbacks may still run, and `close`, which lets go of files, ports and threads when none runs any more.
    """
    replace_what_cannot_be_shown()
    try:
        if about.asked_for_help(sys.argv):
            print(about.help())
            return 0
    except (StartError, RCLError, UnknownROSArgsError) as error:  # the latter: ROS does not understand its own arguments
        print(f"error: {_told(error)}", file=sys.stderr)
        return 1
    try:
        require_known("variable", [name for name in os.environ if name.startswith("SIXSTRUT_")], VARIABLES, "It changes nothing")
    except StartError as error:
        print(f"warning: {error}", file=sys.stderr)
    ends: SimpleQueue[int] = SimpleQueue()  # its put may be called from a signal handler
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ends.put(0))
    try:
        set_discovery()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = make_node(ends.put)
    except (StartError, SimError, RCLError, UnknownROSArgsError) as error:
        print(f"error: {_told(error)}", file=sys.stderr)
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
