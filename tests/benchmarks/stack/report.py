# SPDX-License-Identifier: Apache-2.0
"""The stack's figures as a page, as JSON and as a picture."""

import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tensegrity_lab.reports.figure import STRUT_COLORS, new_figure, picture_file
from tensegrity_lab.reports.markdown import table
from tests.benchmarks.stack.metrics import Capacity, Latency, Load, Spread, StackReport, StartUp, TwinCost, Usage


def as_json(report: StackReport) -> str:
    """All figures; null for those that could not be measured."""
    return json.dumps(_plain(asdict(report)), indent=1)


def _plain(value: Any) -> Any:
    """Without not-a-number, which JSON has not."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def as_markdown(report: StackReport, picture: str | None) -> str:
    """The report as a document."""
    r = report
    parts = [
        "# What the stack itself costs",
        "Written by `./sixstrut bench --stack --page`; do not edit. Every process is the real one, the board is the virtual "
        "prototype's on a pseudo-terminal; no robot and no Bluetooth module was there. Processor time is in percent of one core.",
        f"{r.processor}; {r.processors} processors; Python {r.python}, {r.rmw}; load average before {r.load[0]:.1f}, at the "
        f"end {r.load[1]:.1f}. Before, it should be near 0: whatever else ran is in these figures.",
        *([f"![evenness, latency, processor time, start]({picture})"] if picture else []),
        f"## The twin at {r.plan.rate_hz:g} Hz",
        "In real time, on absolute deadlines of the steady clock. *Uneven*: how far the interval between two stamps is from the "
        "period; *heard*: the same at a subscriber in another process. The twin that follows steps its model 20 times a second, "
        "when an event comes, and shows the last state in between; the one that is the robot steps at every deadline.",
        _twins(r.twins),
        "## From a call to the bytes",
        "From the ROS call in another process until the frame was handed to the operating system, as the bridge stamps it. Both "
        "are stamps of this machine's clock; a time during which that was set against the steady clock is dropped.",
        _latencies(r.latencies),
        "## The recorder",
        _recorder(r.recording, r.recorder),
        "## The demo's processes",
        f"`./sixstrut demo --rolls {r.plan.rolls}` at its default pace, eight times real time. *Starting*: processor time until "
        "the robot is armed; *running*: from then to the last roll's end. *PSS*: memory, shared pages divided among their users.",
        _usages(r.usages),
        "## Start",
        _start_up(r.start_up),
    ]
    return "\n\n".join(parts) + "\n"


def _ms(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def _spread(s: Spread) -> list[str]:
    return [_ms(s.p50_ms), _ms(s.p99_ms), _ms(s.worst_ms)]


def _twins(twins: Sequence[TwinCost]) -> str:
    rows = [
        [t.doing, f"{t.published_hz:.1f}", *_spread(t.uneven), *_spread(t.heard)[:2], f"{100 * t.cpu:.0f} %", f"{t.uneven.times}"]
        for t in twins
    ]
    head = ["the twin", "Hz", "uneven p50 ms", "p99", "worst", "heard p50 ms", "p99", "processor", "intervals"]
    return table(head, rows)


def _latencies(latencies: Sequence[Latency]) -> str:
    rows = [[x.call, *_spread(x.spread), f"{x.spread.times}", f"{x.dropped}", x.note] for x in latencies]
    return table(["", "p50 ms", "p99", "worst", "times", "dropped", ""], rows)


def _recorder(load: Load, c: Capacity) -> str:
    running = (
        f"In the stack above the bridge recorded {load.messages_per_s:.0f} messages/s, {load.kb_per_s:.0f} kB/s; at most "
        f"{load.most_waiting} of {c.queue} waited for the disk."
    )
    alone = (
        f"Alone, {c.messages} messages, that session's over and over: {c.messages_per_s:.0f} messages/s, {c.mb_per_s:.1f} MB/s, "
        f"each with the operating system when it counts as written, then {c.finish_s:.1f} s to rewrite, index and read back all at "
        f"the end. {c.burst} messages at once take {c.call_us:.0f} µs each from their callers, wait in the queue (at most "
        f"{c.most_waiting}) and are written {c.drained_s:.2f} s after the first."
    )
    full = (
        f"Given messages faster than it can write, without an end, it takes {c.accepted}, then says “{c.fault}”, refuses and "
        f"counts the rest ({c.lost} here), and its log holds {c.recorded}: nothing is dropped silently."
    )
    return "\n\n".join((running, alone, full))


def _usages(usages: Sequence[Usage]) -> str:
    rows = [[u.process, f"{u.starting_s:.1f}", f"{100 * u.cpu:.0f} %", f"{u.rss_mb:.0f}", f"{u.pss_mb:.0f}"] for u in usages]
    return table(["process", "starting, s", "running", "RSS, MB", "PSS, MB"], rows)


def _start_up(s: StartUp) -> str:
    rows = [
        [
            stage.stage,
            f"{stage.wall_s:.1f}",
            f"{stage.cpu_s:.1f}",
            f"{stage.functions}",
            ", ".join(f"{name} {seconds:.1f}" for name, seconds in stage.longest),
        ]
        for stage in s.cold.stages
    ]
    rows.append(["the whole process", f"{s.cold.wall_s:.1f}", f"{s.cold.cpu_s:.1f}", f"{s.cold.functions}", ""])
    rows.append(["the next process", f"{s.second.wall_s:.1f}", f"{s.second.cpu_s:.1f}", f"{s.second.functions}", ""])
    published, heard = ([getattr(state, name) for state in s.warm] for name in ("published_s", "heard_s"))
    first = (
        f"A twin publishes its first state {_median(published)} after its process began when everything is compiled "
        f"({statistics.median(state.cpu_s for state in s.warm):.2f} s of processor time until somebody hears it), and after "
        f"{s.cold_twin.published_s:.1f} s with an empty cache. Somebody who was there before hears one, warm, after "
        f"{_median(heard)}: middleware in two processes has to find each other first."
    )
    compiling = (
        "Compiling the solver with an empty cache, in one process. Compiled code is kept beside the sources, or below "
        "`NUMBA_CACHE_DIR`, in a folder named by a hash of the sources that compiled functions use; in it a function is found by "
        "its file's time of change, its arguments' types, the versions of numba and Python, and the processor."
    )
    return "\n\n".join((compiling, table(["", "s", "processor, s", "functions", "longest, own processor s"], rows), first))


def _median(times_s: Sequence[float]) -> str:
    return f"{statistics.median(times_s):.2f} s (median of {len(times_s)}, worst {max(times_s):.2f} s)"


@picture_file
def draw(report: StackReport, path: Path) -> None:
    """Evenness, latency, processor time, start."""
    figure = new_figure(12, 7)
    (even, late), (use, start) = figure.subplots(2, 2)
    for place, (label, pick) in enumerate((("p50", "p50_ms"), ("p99", "p99_ms"), ("worst", "worst_ms"))):
        at = [row + 0.27 * (place - 1) for row in range(len(report.twins))]
        even.barh(at, [getattr(t.uneven, pick) for t in report.twins], 0.25, color=STRUT_COLORS[place], label=label)
    even.set_yticks(range(len(report.twins)), [t.doing for t in report.twins])
    even.invert_yaxis()
    even.set_xlabel("interval between stamps, off the period (ms)")
    even.set_title(f"twin at {report.plan.rate_hz:g} Hz")
    even.legend(frameon=False)
    for latency, color in zip(report.latencies, STRUT_COLORS, strict=False):
        times = sorted(latency.times_ms)
        late.step(times, [(place + 1) / len(times) for place in range(len(times))], where="post", color=color, label=latency.call)
    late.set_xscale("log")
    late.set_xlabel("from the call to the bytes (ms)")
    late.set_ylabel("share of the calls")
    late.set_title("latency")
    late.legend(frameon=False, fontsize="small")
    processes = [u for u in report.usages if u.process != "all"]
    use.barh([u.process for u in processes], [100 * u.cpu for u in processes], color=STRUT_COLORS[0])
    for place, usage in enumerate(processes):
        use.annotate(f" {usage.pss_mb:.0f} MB", (100 * usage.cpu, place), va="center")
    use.margins(x=0.2)
    use.set_xlabel("percent of one core, while rolling; PSS beside it")
    use.set_title("the demo's processes")
    bars = [(f"compile {stage.stage}", stage.wall_s) for stage in report.start_up.cold.stages]
    bars.append(("twin's first state, cold", report.start_up.cold_twin.published_s))
    bars.append(("twin's first state, warm", max(state.published_s for state in report.start_up.warm)))
    start.barh([name for name, _ in bars], [seconds for _, seconds in bars], color=STRUT_COLORS[2])
    start.invert_yaxis()
    start.set_xlabel("s")
    start.set_title("start")
    for axes in (even, late, use, start):
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
