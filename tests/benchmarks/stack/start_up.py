# SPDX-License-Identifier: Apache-2.0
"""From an empty cache to compiled code, and from a twin's start to its first state.

The former is measured in a process of its own, which is this module.
"""

import json
import os
import re
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

from sim_core.rolling.warm_up import ALL, warm_up
from tensegrity_lab.stack.processes import START_LIMIT_S, Stack
from tests.benchmarks.stack.metrics import Compilation, Compiling, FirstState, Plan, StartUp
from tests.benchmarks.stack.probe import Probe
from tests.benchmarks.stack.process_usage import cpu_s

LONGEST = 6
SAID = re.compile(r"first state published ([0-9.]+) s after")


def measure(plan: Plan, folder: Path, locks: tuple[int, ...]) -> StartUp:
    """Compile into a cache of its own under `folder`, twice; start twins. Args: locks: of the ROS domain. Raises StackError."""
    cold, second = (_compile(folder / "cache") for _ in range(2))
    first_state(folder / "before", folder / "cache", locks)
    warm = tuple(first_state(folder / f"start-{number}", folder / "cache", locks) for number in range(plan.starts))
    return StartUp(cold, second, warm, first_state(folder / "cold", folder / "another-cache", locks))


def _compile(cache: Path) -> Compilation:
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    wall_s = time.monotonic() - began
    rows, whole_s = json.loads(done.stdout)
    stages = tuple(
        Compiling(stage, took_s, used_s, count, tuple((name, own_s) for name, own_s in longest))
        for stage, took_s, used_s, count, longest in rows
    )
    return Compilation(stages, wall_s, whole_s)


def first_state(folder: Path, cache: Path, locks: tuple[int, ...] = ()) -> FirstState:
    """A twin without a bridge, heard by somebody who was there before."""
    with Stack(folder, *locks) as stack, Probe(stack) as probe:
        began_ns = time.monotonic_ns()
        stack.node("twin", environ={"NUMBA_CACHE_DIR": str(cache)})
        probe.wait(lambda: probe.states, "the twin's first state", START_LIMIT_S)
        probe.wait(lambda: published_s(folder / "twin.log"), "the twin's word about it")
        used_s = cpu_s(stack.pid("twin"))
        return FirstState(published_s(folder / "twin.log") or 0.0, 1e-9 * (probe.states[0] - began_ns), used_s)


def published_s(log: Path) -> float | None:
    """When a twin says it published its first state; None while it has not."""
    found = SAID.search(log.read_text(encoding="utf-8", errors="replace"))
    return float(found[1]) if found else None


def main() -> None:
    """Compile every stage; print a row each (name, seconds, processor seconds, functions, the longest), and processor seconds."""
    rows = []
    for stage in ALL:
        began, used, own_s = time.monotonic(), time.process_time(), defaultdict[str, float](float)
        done = warm_up([stage])
        for compiled in done:
            own_s[compiled.name] += compiled.own_s
        longest = sorted(own_s.items(), key=lambda row: -row[1])[:LONGEST]
        rows.append((stage.value, time.monotonic() - began, time.process_time() - used, len(done), longest))
    print(json.dumps((rows, time.process_time())))


if __name__ == "__main__":
    main()
