# SPDX-License-Identifier: Apache-2.0
"""A benchmark's figures as a table, as JSON and as a picture."""

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from tensegrity_lab.reports.figure import STRUT_COLORS, new_figure, picture_file
from tensegrity_lab.reports.markdown import table
from tests.benchmarks.solver.equilibrium import Rest
from tests.benchmarks.solver.measure import Accuracy, Judged, Memory, Plan, Rehearsal, Speed


@dataclass(frozen=True)
class Machine:
    """Where it was measured.

    Attributes:
        load: processes that wanted to run, in the minutes before and at the end; more than the threads measured means that the
            figures suffered.
    """

    processor: str
    processors: int
    python: str
    numba: str
    mujoco: str
    load: tuple[float, float]


@dataclass(frozen=True)
class Report:
    """Everything that a run measured."""

    machine: Machine
    plan: Plan
    model_hash: str
    speeds: Sequence[Speed]
    judged: Judged
    rehearsal: Rehearsal
    rests: Sequence[Rest]
    accuracies: Sequence[Accuracy]
    memories: Sequence[Memory]


def this_machine(mujoco_version: str, load: tuple[float, float]) -> Machine:
    """The machine, in words."""
    return Machine(processor(), os.cpu_count() or 1, platform.python_version(), version("numba"), mujoco_version, load)


def processor() -> str:
    """The processor's name and the width of its vectors."""
    names = [line.split(":", 1)[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")]
    flags = next((line for line in _lines("/proc/cpuinfo") if line.startswith("flags")), "").split()
    width = "AVX-512" if "avx512f" in flags else "AVX2" if "avx2" in flags else "SSE2"
    return f"{names[0] if names else platform.machine()}, {width}"


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def as_json(report: Report) -> str:
    """The figures for programs."""
    document = asdict(report)
    for row, speed in zip(document["speeds"], report.speeds, strict=True):
        row["robot_seconds_per_s"] = speed.robot_seconds_per_s
    return json.dumps(document, indent=1)


def as_markdown(report: Report, picture: str | None) -> str:
    """The report as a document."""
    m, plan = report.machine, report.plan
    others = max(m.load) > plan.threads[-1]
    slowed = f": the load was above {plan.threads[-1]}, so other programs were running, and slowed both engines" if others else ""
    parts = [
        "# Benchmark",
        "Written by `./sixstrut bench --page`; do not edit. The same robot, the same policies, one run, the engines in turn, the "
        f"fastest of {plan.rounds} measurements each. MuJoCo's model is made from the same numbers "
        "(`sim_core/sim_core/structure/mujoco_model.py` says what differs); its batches run in its own thread pool "
        "(`mujoco.rollout`), one robot by `mj_step`.",
        f"{m.processor}; {m.processors} processors; Python {m.python}, numba {m.numba}, MuJoCo {m.mujoco}; "
        f"model {report.model_hash}; load average before {m.load[0]:.1f}, "
        f"at the end {m.load[1]:.1f}{slowed}.",
        *([f"![speed and accuracy]({picture})"] if picture else []),
        "## Speed",
        "Robots in the middle of rolls, each at another moment of another roll. *× real time*: robot-seconds a second. "
        "The last column of a row is how many times faster sixstrut is than MuJoCo at that step.",
        *(_speed_table(report, threads) for threads in plan.threads),
        f"Complete rolls, judged, in a batch of {report.judged.rolls} on {_threads(report.judged.threads)}: "
        f"{report.judged.rolls_per_s:.1f} rolls/s, {report.judged.robot_seconds_per_s:.0f} robot-seconds/s.",
        f"Rehearsal: one gait on {report.rehearsal.members} perturbed robots, settled before, on "
        f"{_threads(report.rehearsal.threads)}: {report.rehearsal.seconds:.2f} s, median of {report.rehearsal.gaits} gaits.",
        "## Accuracy",
        "Each engine against itself at a quarter of the step: half gaits of the library `robust`, half random policies. "
        "The gaits were chosen for being reliable and a random policy seldom rolls, so *same face* is a weak test; *rolled* is "
        "how many policies end on another face than their first. "
        "*Same face*: ends on the same face. *End*: distance between the centre's end positions. *Came to rest*: within the "
        "rule's 15 s. The last row compares the two engines at their finest: how far the two models agree.",
        _accuracy_table(report.accuracies),
        "Both engines at rest on a face, MuJoCo's struts rigid and its contacts softer; worst: largest difference of one "
        "member's force, as a share of the mean.",
        _rest_table(report.rests),
        "## Memory",
        "Resident size of a process that does nothing else, at rest, after some rolls and after four times more.",
        _memory_table(report.memories),
    ]
    return "\n\n".join(parts) + "\n"


def _threads(count: int) -> str:
    return f"{count} thread{'s' if count > 1 else ''}"


def _label(engine: str, step_s: float) -> str:
    return f"{engine}, {1e3 * step_s:.3g} ms"


def _speed_table(report: Report, threads: int) -> str:
    chosen = [s for s in report.speeds if s.threads == threads]
    ours = {s.robots: s for s in chosen if s.engine == "sixstrut"}
    rows = []
    for s in chosen:
        ratio = "" if s.engine == "sixstrut" else f"{ours[s.robots].robot_seconds_per_s / s.robot_seconds_per_s:.1f}"
        speed = f"{s.robot_seconds_per_s:.0f}"
        rows.append([_label(s.engine, s.step_s), f"{s.robots}", f"{s.us_per_robot_step:.2f}", speed, ratio])
    head = [_threads(threads), "robots", "µs per robot-step", "× real time", "sixstrut is × faster"]
    return table(head, rows)


def _accuracy_table(accuracies: Sequence[Accuracy]) -> str:
    rows = [
        [
            _label(a.engine, a.step_s),
            _label(a.reference, a.reference_step_s),
            f"{a.policies}",
            f"{a.rolled}",
            f"{100 * a.same_face:.0f} %",
            f"{a.median_mm:.2f}",
            f"{a.p90_mm:.2f}",
            f"{100 * a.settled:.0f} %",
        ]
        for a in accuracies
    ]
    return table(["", "against", "policies", "rolled", "same face", "end, median mm", "end, 90 % within mm", "came to rest"], rows)


def _rest_table(rests: Sequence[Rest]) -> str:
    rows = []
    for r in rests:
        pairs = [f"{a:.4g} / {b:.4g} ({100 * abs(b / a - 1):.2f} %)" for a, b in (r.height_m, r.tendon_n, r.strut_n)]
        rows.append([r.face, *pairs, f"{100 * r.worst_tendon:.1f} %", f"{100 * r.worst_strut:.1f} %"])
    return table(["sixstrut / MuJoCo", "height m", "tendon N", "strut N", "worst tendon", "worst strut"], rows)


def _memory_table(memories: Sequence[Memory]) -> str:
    rows = [
        [
            m.engine,
            f"{m.robot_kb:.1f}",
            f"{m.thread_kb:.0f}",
            f"{m.idle_mb:.0f}",
            f"{m.once_mb:.0f} ({m.rolls})",
            f"{m.five_times_mb:.0f} ({5 * m.rolls})",
        ]
        for m in memories
    ]
    return table(["", "kB a robot", "kB a thread", "MB idle", "MB after (rolls)", "MB after (rolls)"], rows)


@picture_file
def draw(report: Report, path: Path) -> None:
    """Speed over the number of robots, and speed over the error at equal truth."""
    figure = new_figure(11, 4.6)
    left, right = figure.subplots(1, 2)
    kinds = list(dict.fromkeys((s.engine, s.step_s) for s in report.speeds))
    most = report.plan.threads[-1]
    for (engine, step), color in zip(kinds, STRUT_COLORS, strict=False):
        for threads, style in zip(report.plan.threads, ("--", "-"), strict=False):
            rows = [s for s in report.speeds if (s.engine, s.step_s, s.threads) == (engine, step, threads)]
            label = _label(engine, step) if threads == most else None
            speed = [s.robot_seconds_per_s for s in rows]
            left.plot([s.robots for s in rows], speed, style, color=color, marker="o", ms=4, label=label)
        fastest = max(s.robot_seconds_per_s for s in report.speeds if (s.engine, s.step_s) == (engine, step))
        error = next(a.median_mm for a in report.accuracies if (a.engine, a.step_s) == (engine, step))
        right.plot(error, fastest, "o", ms=9, color=color)
        right.annotate(_label(engine, step), (error, fastest), xytext=(8, 6), textcoords="offset points")
    left.set_xscale("log", base=8)
    left.set_xticks(report.plan.counts, [str(count) for count in report.plan.counts])
    left.set_xlabel("robots")
    left.set_title(f"dashed 1 thread, solid {most}" if most > 1 else "1 thread")
    left.legend(frameon=False, ncol=2, loc="upper center")
    right.set_xscale("log")
    right.margins(x=0.5, y=0.25)
    right.set_xlabel("median error of the end position, own quarter step (mm)")
    right.set_title("speed and own error: up and left is better")
    for axes in (left, right):
        axes.set_yscale("log")
        axes.set_ylabel("robot-seconds per second")
        axes.grid(color="0.9", which="both")
    speeds = [s.robot_seconds_per_s for s in report.speeds]
    left.set_ylim(0.5 * min(speeds), 4 * max(speeds))  # room for the legend
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
