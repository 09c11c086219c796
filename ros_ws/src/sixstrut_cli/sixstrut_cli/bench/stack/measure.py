"""The whole measurement of the stack, part by part, in a ROS domain and folders of its own."""

from __future__ import annotations

import os
import platform
import random
import tempfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from sixstrut_cli.bench.report import processor
from sixstrut_cli.bench.stack import demo_usage, recording, running, start_up
from sixstrut_cli.bench.stack.figures import Plan, StackReport


def measure(plan: Plan, say: Callable[[str], None]) -> StackReport:
    """Run everything. Raises StackError, and what the processes' own errors become there."""
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(1, 100))  # it must meet no robot of this machine
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="sixstrut-bench-") as name:
        folder = Path(name)
        say("start: compiling with an empty cache, then starting twins")
        start = start_up.measure(plan, folder)
        ran = running.run(plan, folder, say)
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
