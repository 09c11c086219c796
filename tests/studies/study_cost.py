# SPDX-License-Identifier: Apache-2.0
"""What a large study costs, and where more cores stop to help: from the figures of a study just done."""

import os
import pickle
import platform
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from sim_core.structure.parameters import Prototype
from sim_core.studies.binomial_intervals import rate_of
from sim_core.studies.local_runner import Chunk, Cost, Trials
from sim_core.studies.robustness import GAITS, Study, chunk_jobs, chunks_of
from tensegrity_lab.reports.markdown import table

TASKS, REPEATS = 40, 5
CORES = (2, 64, 1024)
MILLION = 1_000_000


class Figures(NamedTuple):
    """Measured.

    Attributes:
        primitives: of the library.
        cost: of the study.
        chunk_rolls: rolls in a chunk of a large study.
        sent_bytes, back_bytes: pickled chunk and its trials.
        task_s: time of the cluster's scheduler and client a chunk.
    """

    primitives: int
    cost: Cost
    chunk_rolls: int
    sent_bytes: int
    back_bytes: int
    task_s: float

    @property
    def table(self) -> str:
        """Markdown, see `table_of`."""
        return table_of(self)

    @property
    def document(self) -> dict[str, Any]:
        """The measured figures for scripts."""
        return {**self._asdict(), "cost": self.cost._asdict()}


def figures_of(prototype: Prototype, study: Study) -> Figures:
    """Measure what is not in the study: a large study's chunk, and its overhead on a Dask cluster of this machine's cores."""
    rolls = len(study.primitives) * study.plan.shape[0]
    size = chunk_jobs(MILLION * rolls)
    large = replace(study.plan, prototypes=max(1, size // rolls))
    chunk = chunks_of(prototype, study.primitives, large, size=size)[0]
    sizes = len(pickle.dumps(chunk)), len(pickle.dumps(no_work(chunk, "")))
    return Figures(len(study.primitives), study.cost, len(chunk.jobs), *sizes, _overhead_s(chunk))


def no_work(chunk: Chunk, _sources: str) -> Trials:
    """Trials as large as a chunk's, of nothing done."""
    n = len(chunk.jobs)
    columns = list(np.zeros((9, n), dtype=np.float32))
    return Trials._make([np.zeros(n, dtype=np.bool_), *columns, ("",) * n, (False,) * n, ("",) * n, Cost()])


def _overhead_s(chunk: Chunk) -> float:
    from distributed import Client, LocalCluster

    from sim_core.studies.dask_runner import run_on

    with (
        LocalCluster(n_workers=os.cpu_count(), threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        run_on(client, [chunk] * 4, work=no_work)
        times = []
        for _ in range(REPEATS):
            began = perf_counter()
            run_on(client, [chunk] * TASKS, work=no_work)
            times.append((perf_counter() - began) / TASKS)
    return min(times)


def table_of(figures: Figures, prototypes: int = MILLION) -> str:
    """Markdown: the figures, and what a study of so many prototypes follows from them."""
    f, cost = figures, figures.cost
    core_s_a_trial = cost.core_s / cost.trials
    chunk_s, trials = f.chunk_rolls * core_s_a_trial, prototypes * f.primitives * GAITS
    core_hours, limit = trials * core_s_a_trial / 3600.0, chunk_s / f.task_s
    back_gb = 1e-9 * trials * f.back_bytes / f.chunk_rolls
    rows: list[tuple[str, str]] = [
        ("robot-seconds a trial, settling included", f"{cost.robot_s / cost.trials:.1f}"),
        ("core-milliseconds a robot-second", f"{1e3 * cost.core_s / cost.robot_s:.2f}"),
        ("of it, to draw and build prototypes", f"{100 * cost.build_s / cost.core_s:.1f} %"),
        ("a chunk: rolls; core-seconds", f"{f.chunk_rolls}; {chunk_s:.1f}"),
        ("a chunk: kB sent; kB back", f"{f.sent_bytes / 1e3:.0f}; {f.back_bytes / 1e3:.0f}"),
        ("scheduler and client, ms a chunk", f"{1e3 * f.task_s:.1f}"),
        (f"{prototypes:,} prototypes × {f.primitives} primitives × {GAITS} gaits: trials", f"{trials:.3g}"),
        ("robot-seconds", f"{trials * cost.robot_s / cost.trials:.3g}"),
        ("core-hours", f"{core_hours:,.0f}"),
        (f"the same with --one-gait on {prototypes:,} prototypes in all, core-hours", f"{core_hours / GAITS:,.0f}"),
        *((f"hours on {cores:,} cores", f"{core_hours / cores:,.1f}") for cores in CORES if cores < limit),
        ("the scheduler is saturated at, cores", f"{limit:,.0f}"),
        ("hours then, which more cores do not shorten", f"{core_hours / limit:,.2f}"),
        ("network there, MB/s", f"{(f.sent_bytes + f.back_bytes) / f.task_s / 1e6:.1f}"),
        ("results at the client, GB (cut the study with --first beyond its memory)", f"{back_gb:.1f}"),
    ]
    for count in (20, 1000, prototypes):
        n = count * GAITS
        rate = rate_of(round(0.97 * n), n)
        rows.append((f"95 % interval of a primitive at 97 %, {count:,} prototypes", f"± {50 * (rate.high - rate.low):.3f} %"))
    where = f"{platform.machine()}, {os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}"
    return table((f"figure, on {where}", ""), rows)
