# SPDX-License-Identifier: Apache-2.0
"""Compiles every kernel once, into numba's cache (see `dynamics.jit_cache`): `python -m sim_core.rolling.warm_up`.

How compiled code is found again: its folder is named by the sources of the kernels; in it, numba keys a function by its file's
time of change, the types of its arguments, and the versions of numba and Python and the processor.
"""

import platform
import sys
import time
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numba
from numba.core import event

from sim_core.dynamics.jit_cache import use_own_folder
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.elements import KINDS
from sim_core.structure.parameters import load_prototype


class Stage(StrEnum):
    """What can be compiled by itself; the value is for people."""

    ROBOT = "one robot"
    ROLL = "one judged roll, both models"
    BATCH = "many rolls at once"


ALL = tuple(Stage)


class Compiled(NamedTuple):
    """A function that was compiled: its name, for which stage, in what processor time without the functions that it calls."""

    name: str
    stage: Stage
    own_s: float


Report = Callable[[str, int], None]
"""Told the function that is being compiled, and how many have been before it."""


def is_warm(stages: Sequence[Stage] = (Stage.ROBOT,)) -> bool:
    """Whether `warm_up` was here with these very kernels, on this processor, with these versions."""
    return all(_mark(stage).exists() for stage in stages)


def warm_up(stages: Sequence[Stage] = ALL, report: Report = lambda name, count: None) -> list[Compiled]:
    """Run briefly whatever the stages need compiled; what was compiled, in the order in which it was done."""
    watch = _Watch(report)
    with event.install_listener("numba:compile", watch):
        for stage in stages:
            watch.stage = stage
            _run(stage)
            mark = _mark(stage)
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()
    return watch.done


def _mark(stage: Stage) -> Path:
    key = f"{numba.__version__}-{platform.python_version()}-{llvmlite.binding.get_host_cpu_name()}"
    return use_own_folder() / f"warm-{stage.name.lower()}-{key}"


def _run(stage: Stage) -> None:
    from sim_core.rolling.batch import Batch, Job
    from sim_core.rolling.roll import roll

    model = build_model(load_prototype())
    match stage:
        case Stage.ROBOT:
            robot = Robot.resting_on(model, "TC6")
            robot.advance(1)
            robot.footing()
            robot.clearance_m()
        case Stage.ROLL:
            for kind in KINDS:
                roll(build_model(load_prototype(), kind=kind), "TC6", "TO5", (0,) * 6)
        case Stage.BATCH:
            Batch([model], 1).run([Job(0, "TC6", (0,) * 6)])


class _Watch(event.Listener):
    """Keeps what numba compiles; functions are compiled inside those that call them."""

    def __init__(self, report: Report):
        self.stage = Stage.ROBOT
        self.done: list[Compiled] = []
        self._report = report
        self._open: list[list[float]] = []  # start, time inside other functions

    def on_start(self, happening: Any) -> None:
        self._report(_name(happening), len(self.done))
        self._open.append([time.process_time(), 0.0])

    def on_end(self, happening: Any) -> None:
        start_s, inside_s = self._open.pop()
        whole_s = time.process_time() - start_s
        if self._open:
            self._open[-1][1] += whole_s
        self.done.append(Compiled(_name(happening), self.stage, whole_s - inside_s))


def _name(happening: Any) -> str:
    function = happening.data["dispatcher"].py_func
    return f"{function.__module__.rpartition('.')[2]}.{function.__name__}"


def main() -> None:
    """Compile all, telling on standard error how far it is."""
    began = time.perf_counter()
    done = warm_up(report=lambda name, count: print(f"compiling {name} ({count} done)", file=sys.stderr, flush=True))
    if done:
        print(f"compiled {len(done)} functions in {time.perf_counter() - began:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
