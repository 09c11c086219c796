# SPDX-License-Identifier: Apache-2.0
"""Processor time and memory of every process of the demo."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import psutil

from hardware_bridge.driver.child_process import bound
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import wait_until
from tests.benchmarks.stack.metrics import Plan, Usage
from tests.benchmarks.stack.process_usage import GONE, Sampler

NODES = ("twin", "gait_planner", "hardware_bridge")
START_LIMIT_S = 120.0
ROLLS_LIMIT_S = 600.0
ARMED = "armed;"


def measure(plan: Plan, folder: Path) -> list[Usage]:
    """Run the demo at its default pace; from armed to its last roll. Raises StackError if it fails."""
    command = [sys.executable, "-m", "sixstrut_cli", "demo", "--rolls", str(plan.rolls), "--bags", str(folder / "demo")]
    demo = subprocess.Popen(bound(command), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    lines: list[str] = []
    reader = threading.Thread(target=lambda: lines.extend(demo.stdout or ()), name="demo's output", daemon=True)
    reader.start()

    def comes(beginning: str, limit_s: float) -> None:
        def came() -> bool:
            return any(line.startswith(beginning) for line in lines)

        wait_until(lambda: came() or demo.poll() is not None, limit_s, f"the demo's line {beginning!r}")
        if not came():
            raise StackError(f"the demo ended with {demo.returncode}: {''.join(lines[-3:]).strip()}")

    try:
        with Sampler(lambda: _processes(demo.pid)) as sampler:
            comes(ARMED, START_LIMIT_S)
            sampler.look(share=True)
            sampler.begin()
            began = time.monotonic()
            comes(f"{plan.rolls:>4}  ", ROLLS_LIMIT_S)  # its last roll's row: everything still runs
            sampler.look(share=True)
            return sampler.usages(time.monotonic() - began)
    finally:
        if demo.poll() is None:
            demo.send_signal(signal.SIGINT)
        demo.wait()
        reader.join()


def _processes(root: int) -> Mapping[str, int]:
    """The demo's processes by what they are."""
    found = {"demo (operator)": root}
    try:
        children = psutil.Process(root).children(recursive=True)
    except GONE:
        return {}
    for child in children:
        try:
            name = name_of(child.cmdline())
        except GONE:
            continue
        if name:
            found[name] = child.pid
    return found


def name_of(command: Sequence[str]) -> str:
    """What a process of the stack is, by its command line; empty if it is none."""
    if "hardware_bridge.virtual_prototype" in command:
        return "virtual_prototype"
    return next((Path(word).name for word in command[:3] if Path(word).name in NODES), "")
