# SPDX-License-Identifier: Apache-2.0
"""The whole measurement of the stack, part by part, in a ROS domain and folders of its own."""

import os
import platform
import tempfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tensegrity_lab.stack.ros_domain import private_domain
from tests.benchmarks.solver.report import processor
from tests.benchmarks.stack import demo_usage, live_stack, recording, start_up
from tests.benchmarks.stack.metrics import Plan, StackReport


def measure(plan: Plan, say: Callable[[str], None]) -> StackReport:
    """Run everything. Raises StackError, and what the processes' own errors become there."""
    load = os.getloadavg()[0]
    with private_domain() as domain, tempfile.TemporaryDirectory(prefix="sixstrut-bench-") as name:
        say(domain.describe)
        folder = Path(name)
        say("start: compiling with an empty cache, then starting twins")
        start = start_up.measure(plan, folder, domain.locks)
        ran = live_stack.run(plan, folder, domain.locks, say)
        say(f"recorder: {plan.messages} messages")
        capacity = recording.measure(ran.bag, folder, plan)
        say(f"the demo: {plan.rolls} roll{'s' if plan.rolls > 1 else ''}")
        usages = demo_usage.measure(plan, folder)
    return StackReport(
        processor(),
        os.cpu_count() or 1,
        platform.python_version(),
        f"{_rclpy()}, {os.environ.get('RMW_IMPLEMENTATION', 'the default middleware')}",
        (load, os.getloadavg()[0]),
        plan,
        tuple(ran.twins),
        tuple(ran.latencies),
        ran.load,
        capacity,
        tuple(usages),
        start,
    )


def _rclpy() -> str:
    for name in ("ros-jazzy-rclpy", "rclpy"):  # as a wheel, as Ubuntu's package
        try:
            return f"rclpy {version(name)}"
        except PackageNotFoundError:
            continue
    return "rclpy"
