# SPDX-License-Identifier: Apache-2.0
"""A process that only rolls, to see its memory: `python -m tests.benchmarks.solver.memory SETTINGS`."""

import json
import sys
from pathlib import Path

import psutil

from sim_core.structure.parameters import load_prototype
from tests.benchmarks.solver.engines import Engine, SixStrut
from tests.benchmarks.solver.measure import Memory, tasks_of
from tests.benchmarks.solver.mujoco_engine import MuJoCo

MUJOCO_STEP_S = 0.002


def main(text: str) -> None:
    """Roll once as many, then four times as many; print a `Memory`."""
    settings = json.loads(text)
    prototype = load_prototype(settings["prototype"])
    engine: Engine = SixStrut(prototype) if settings["engine"] == "sixstrut" else MuJoCo(prototype, MUJOCO_STEP_S)
    tasks = tasks_of(prototype, settings["rolls"], settings["seed"])
    engine.rolls(tasks[:2], settings["threads"])  # compiled, every face's robot not yet settled
    idle = psutil.Process().memory_info().rss * 1e-6
    engine.rolls(tasks, settings["threads"])
    once = _peak_mb()
    engine.rolls(tasks * 4, settings["threads"])
    print(json.dumps(vars(Memory(engine.name, len(tasks), idle, once, _peak_mb(), engine.robot_kb, engine.thread_kb))))


def _peak_mb() -> float:
    """Largest resident size so far. Not `ru_maxrss`: that begins with the size of the process that started this one."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return 1024e-6 * int(line.split()[1])


if __name__ == "__main__":
    main(sys.argv[1])
