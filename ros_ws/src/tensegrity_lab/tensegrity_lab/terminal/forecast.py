# SPDX-License-Identifier: Apache-2.0
"""How long a long computation will take, told before it begins."""

import os
import sys
from time import perf_counter

from sim_core.dynamics.model import Model
from sim_core.dynamics.simd import WIDTH
from sim_core.gaits.library import load_library
from sim_core.rolling.batch import Batch, Job
from tensegrity_lab.terminal.progress import duration_text


def rolls_per_second(model: Model) -> float:
    """Measured in a second or so, on all cores: every lane of the vector unit does two rolls."""
    gait = load_library("robust").gaits("TC6", "TO5")[0]
    threads = os.cpu_count() or 1
    batch = Batch([model], threads)
    batch.settle([(0, gait.source)])
    jobs = [Job(0, gait.source, gait.policy, gait.target)] * (2 * WIDTH * threads)
    began = perf_counter()
    batch.run(jobs)
    return len(jobs) / (perf_counter() - began)


def say_forecast(what: str, rolls: int, model: Model) -> None:
    """Tells on standard error what comes, and about how long it takes here."""
    speed = rolls_per_second(model)
    time = f"about {duration_text(rolls / speed)} at {speed:.0f} rolls/s here"
    print(f"{what}: {rolls} rolls, {time}; Ctrl-C leaves at any time", file=sys.stderr)
