# SPDX-License-Identifier: Apache-2.0
"""The figures of the stack's benchmark, and how raw times become figures. Knows no ROS."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Plan:
    """How much to measure.

    Attributes:
        rate_hz: of the twin.
        seconds: of each of its windows.
        goals, cancels, stops: how often each latency is measured.
        messages: given to the recorder when it is measured alone.
        burst: of them at once.
        starts: of the twin's process.
        rolls: of the demo.
        seed: of the pauses between commands, which must not keep step with the bridge's frames.
    """

    rate_hz: float = 200.0
    seconds: float = 20.0
    goals: int = 120
    cancels: int = 60
    stops: int = 6
    messages: int = 100_000
    burst: int = 10_000
    starts: int = 5
    rolls: int = 3
    seed: int = 1


QUICK = Plan(seconds=4.0, goals=12, cancels=6, stops=1, messages=20_000, starts=2, rolls=1)


class Spread(NamedTuple):
    """Quantiles of so many times in ms; not-a-number if there are none."""

    times: int
    p50_ms: float
    p99_ms: float
    worst_ms: float


@dataclass(frozen=True)
class TwinCost:
    """A twin that publishes at a rate.

    Attributes:
        doing: what the robot does meanwhile.
        asked_hz, published_hz: rates.
        cpu: of one core, 1 is all of it.
        uneven: distance of the intervals between its stamps from the period.
        heard: the same where it is heard.
    """

    doing: str
    asked_hz: float
    published_hz: float
    uneven: Spread
    heard: Spread
    cpu: float


@dataclass(frozen=True)
class Latency:
    """From a ROS call to the bytes' hand-over to the operating system.

    Attributes:
        call: which one.
        note: what is in it.
        spread: of the times.
        dropped: samples during which the wall clock was set.
    """

    call: str
    note: str
    spread: Spread
    dropped: int
    times_ms: tuple[float, ...]


@dataclass(frozen=True)
class Usage:
    """One process, or all.

    Attributes:
        starting_s: processor time until the robot is armed.
        cpu: of one core from then on, 1 is all of it.
        rss_mb: largest resident size.
        pss_mb: resident size with shared pages divided among their users.
    """

    process: str
    starting_s: float
    cpu: float
    rss_mb: float
    pss_mb: float


@dataclass(frozen=True)
class Load:
    """What the bridge records in the running stack. most_waiting: messages that waited for the disk at once."""

    messages_per_s: float
    kb_per_s: float
    most_waiting: int


@dataclass(frozen=True)
class Capacity:
    """The recorder alone, fed with the messages of that session.

    Attributes:
        messages_per_s, mb_per_s: written one by one, each with the operating system when it counts as written.
        finish_s: rewriting, indexing and reading back all of them at the end.
        burst: messages given at once;
        call_us: what one call took then; most_waiting;
        drained_s: until all were written.
        queue: how many may wait.
        accepted, lost: of messages given faster than the disk takes them, up to the fault and after it.
        recorded: messages in that log.
        fault: what it says.
    """

    messages: int
    messages_per_s: float
    mb_per_s: float
    finish_s: float
    burst: int
    call_us: float
    most_waiting: int
    drained_s: float
    queue: int
    accepted: int
    lost: int
    recorded: int
    fault: str


@dataclass(frozen=True)
class Compiling:
    """Of one stage with an empty cache.

    Attributes:
        stage: which.
        wall_s, cpu_s: time and processor time.
        functions: how many.
        longest: those that took longest, with their own processor seconds, without the functions that they call.
    """

    stage: str
    wall_s: float
    cpu_s: float
    functions: int
    longest: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Compilation:
    """A process that compiles all stages and ends: wall_s and cpu_s are of all of it, imports too."""

    stages: tuple[Compiling, ...]
    wall_s: float
    cpu_s: float

    @property
    def functions(self) -> int:
        """How many were compiled."""
        return sum(stage.functions for stage in self.stages)


@dataclass(frozen=True)
class FirstState:
    """A twin's start, in s from that of its process.

    Attributes:
        published_s: until it has published its first state.
        heard_s: until somebody hears one.
        cpu_s: processor time that it has used by then.
    """

    published_s: float
    heard_s: float
    cpu_s: float


@dataclass(frozen=True)
class StartUp:
    """From nothing to a twin.

    Attributes:
        cold, second: with an empty cache, and a process after it.
        warm: twins that find everything compiled.
        cold_twin: one that finds nothing.
    """

    cold: Compilation
    second: Compilation
    warm: tuple[FirstState, ...]
    cold_twin: FirstState


@dataclass(frozen=True)
class StackReport:
    """Everything, and where it was measured. load: processes that wanted to run, before and at the end."""

    processor: str
    processors: int
    python: str
    rmw: str
    load: tuple[float, float]
    plan: Plan
    twins: tuple[TwinCost, ...]
    latencies: tuple[Latency, ...]
    recording: Load
    recorder: Capacity
    usages: tuple[Usage, ...]
    start_up: StartUp


def spread(times_ms: Sequence[float]) -> Spread:
    """Median, 99th percentile and largest."""
    if not len(times_ms):
        return Spread(0, float("nan"), float("nan"), float("nan"))
    p50, p99 = np.quantile(times_ms, [0.5, 0.99])
    return Spread(len(times_ms), float(p50), float(p99), float(np.max(times_ms)))


def uneven_ms(times_ns: Sequence[int], period_s: float) -> list[float]:
    """How far each interval is from the period, in ms."""
    return [abs(float(interval) - 1e9 * period_s) * 1e-6 for interval in np.diff(np.asarray(times_ns, dtype=np.int64))]


def first_write_ns(writes: Sequence[tuple[int, bool]], since_ns: int) -> int | None:
    """Stamp of the first write, given (stamp in ns, heartbeat) in order, at or after `since_ns`; heartbeats write nothing."""
    return next((stamp for stamp, heartbeat in writes if stamp >= since_ns and not heartbeat), None)


def last_write_ns(writes: Sequence[tuple[int, bool]], since_ns: int) -> int | None:
    """Stamp of the last write at or after `since_ns`: that which holds the struts, once a motion has been ended."""
    return next((stamp for stamp, heartbeat in reversed(writes) if stamp >= since_ns and not heartbeat), None)
