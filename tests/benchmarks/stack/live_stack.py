# SPDX-License-Identifier: Apache-2.0
"""The running stack in real time: the twin at its rate, latencies, what the bridge records."""

import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hardware_bridge.recording.bag_on_disk import journal_of
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.errors import StackError, granted
from tensegrity_lab.stack.processes import START_LIMIT_S, Stack
from tensegrity_lab.stack.virtual_stack import start_prototype
from tests.benchmarks.stack.metrics import (
    Latency,
    Load,
    Plan,
    TwinCost,
    first_write_ns,
    last_write_ns,
    spread,
    uneven_ms,
)
from tests.benchmarks.stack.probe import Probe
from tests.benchmarks.stack.process_usage import cpu_s

Say = Callable[[str], None]
STROKE_M = 0.001
MOTION_S = 0.15
LONG_STROKE_M = 0.004
LONG_MOTION_S = 2.0
CLOCK_SET_NS = 50_000
"""The wall clock moved by more than this against the steady one: a time across it says nothing."""


class Running(NamedTuple):
    """What a running stack told; `bag` is its session."""

    twins: list[TwinCost]
    latencies: list[Latency]
    load: Load
    bag: Path


def run(plan: Plan, folder: Path, locks: tuple[int, ...], say: Say) -> Running:
    """Start prototype, bridge and twin, measure, and end them. Args: locks: of the ROS domain. Raises StackError."""
    neutral = neutral_lengths(load_prototype()).tolist()
    twins: list[TwinCost] = []
    with Stack(folder / "logs", *locks) as stack, Probe(stack) as probe:
        probe.prototype = _start(stack, folder, plan)
        say(f"the stack in real time, twin at {plan.rate_hz:g} Hz: at rest")
        probe.meet_stack()
        bag = Path(probe.bridge.bag)
        with _load(probe, bag) as load:
            with _twin(probe, stack, plan, "follows, at rest", twins):
                time.sleep(plan.seconds)
            probe.take_lease(neutral)
            with _twin(probe, stack, plan, "follows, struts moving", twins):
                say(f"latency: {plan.goals} goals, {plan.cancels} cancels, {plan.stops} stops")
                latencies = _latencies(probe, plan, neutral)
    alone = folder / "alone"
    with Stack(alone, *locks) as stack, Probe(stack) as probe:
        say(f"the twin as the robot at {plan.rate_hz:g} Hz")
        stack.node("twin", mode="standalone", rate_hz=plan.rate_hz)
        probe.wait(lambda: probe.ticks, "the twin", START_LIMIT_S)
        with _twin(probe, stack, plan, "is the robot", twins):
            time.sleep(plan.seconds)
    return Running(twins, latencies, load[0], bag)


def _start(stack: Stack, folder: Path, plan: Plan) -> str:
    link = folder / "prototype"
    prototype = start_prototype(stack, link, {}).instance
    stack.node("twin", rate_hz=plan.rate_hz)
    stack.node("hardware_bridge", port=link, bag_folder=folder, state_folder=folder)
    return prototype


@contextmanager
def _twin(probe: Probe, stack: Stack, plan: Plan, doing: str, found: list[TwinCost]) -> Iterator[None]:
    """Measures the twin while the block lasts."""
    pid = stack.pid("twin")
    last = probe.ticks[-1][0]
    probe.wait(lambda: probe.ticks[-1][0] > last, "the twin's next state")
    first, began, used = len(probe.ticks), time.monotonic(), cpu_s(pid)
    yield
    cpu = (cpu_s(pid) - used) / (time.monotonic() - began)
    found.append(twin_cost(doing, plan.rate_hz, probe.ticks[first:], cpu))


def twin_cost(doing: str, rate_hz: float, ticks: Sequence[tuple[int, int]], cpu: float) -> TwinCost:
    """From (stamp, when heard), both in ns, of consecutive publications."""
    stamps, heard = zip(*ticks, strict=True)
    hz = 1e9 * (len(stamps) - 1) / (stamps[-1] - stamps[0])
    return TwinCost(doing, rate_hz, hz, spread(uneven_ms(stamps, 1 / rate_hz)), spread(uneven_ms(heard, 1 / rate_hz)), cpu)


@contextmanager
def _load(probe: Probe, bag: Path) -> Iterator[list[Load]]:
    """Gives a list that holds, after the block, what the bridge recorded meanwhile."""
    found: list[Load] = []
    journal = journal_of(bag)

    def look() -> tuple[float, int, int, int]:
        before = probe.log
        probe.wait(lambda: probe.log is not None and probe.log != before, "the bridge's diagnostics")
        assert probe.log is not None
        return (*probe.log, journal.stat().st_size)

    first_s, first_messages, _, first_size = look()
    yield found
    last_s, last_messages, waiting, last_size = look()
    span_s = last_s - first_s
    found.append(Load((last_messages - first_messages) / span_s, 1e-3 * (last_size - first_size) / span_s, waiting))


# ---- latency ------------------------------------------------------------------------------------------------------------


def _latencies(probe: Probe, plan: Plan, neutral: list[float]) -> list[Latency]:
    rng = random.Random(plan.seed)
    goals, cancels, stops = _Times(probe), _Times(probe), _Times(probe)
    for number in range(plan.goals):
        goals.begin()
        handle = _move(probe, [length + STROKE_M * (number % 2 == 0) for length in neutral], MOTION_S)
        called = probe.asked_ns
        probe.end(handle)
        goals.end(called, first_write_ns)
        time.sleep(rng.uniform(0.0, 0.06))  # over more than a frame's period
    for number in range(plan.cancels):
        handle = _move(probe, [length + LONG_STROKE_M * (number % 2 == 0) for length in neutral], LONG_MOTION_S)
        time.sleep(rng.uniform(0.1, 0.2))
        cancels.begin()
        probe.cancel(handle)
        called = probe.asked_ns
        probe.end(handle)
        cancels.end(called, last_write_ns)
    for number in range(plan.stops):
        _move(probe, [length + LONG_STROKE_M * (number % 2 == 0) for length in neutral], LONG_MOTION_S)
        time.sleep(rng.uniform(0.1, 0.2))
        stops.begin()
        stops.end(probe.trigger_at("stop"), last_write_ns)
        probe.lease = ""
        granted(probe.trigger("reset"), "reset was refused")
        probe.sees(BridgeState.DISARMED)
        probe.take_lease()
    return [
        goals.latency("execute_struts goal → first frame", "waits for the next frame's turn, up to 50 ms"),
        cancels.latency("cancel → frame that holds", "waits for nothing"),
        stops.latency("stop → frame that holds", "waits for nothing"),
    ]


def _move(probe: Probe, lengths_m: list[float], seconds: float) -> Any:
    handle = probe.begin_motion((seconds, lengths_m), lease=probe.lease)
    if not handle.accepted:
        raise StackError("the bridge rejected a motion")
    return handle


class _Times:
    """Times from a call to a write. Both ends are stamped by this machine's wall clock, which is checked against the steady one."""

    def __init__(self, probe: Probe):
        self._probe = probe
        self._times_ms: list[float] = []
        self._dropped = 0
        self._offset_ns = 0

    def begin(self) -> None:
        self._offset_ns = _offset_ns()

    def end(self, called_ns: int, find: Callable[[Sequence[tuple[int, bool]], int], int | None]) -> None:
        """After the call's answer: a heartbeat from after it says that every write before has been heard."""
        probe, answered_ns = self._probe, self._probe.now_ns()
        probe.wait(lambda: probe.sent[-1].heartbeat and probe.stamp_ns(probe.sent[-1]) > answered_ns, "the bridge's next heartbeat")
        written_ns = find(probe.writes, called_ns)
        if written_ns is None or abs(_offset_ns() - self._offset_ns) > CLOCK_SET_NS:
            self._dropped += 1
        else:
            self._times_ms.append(1e-6 * (written_ns - called_ns))

    def latency(self, call: str, note: str) -> Latency:
        return Latency(call, note, spread(self._times_ms), self._dropped, tuple(self._times_ms))


def _offset_ns() -> int:
    """Wall clock minus steady clock; the tightest of some tries, which may be interrupted between the two."""
    tries = []
    for _ in range(5):
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        tries.append((after - before, wall - (before + after) // 2))
    return min(tries)[1]
