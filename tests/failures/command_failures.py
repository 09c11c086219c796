# SPDX-License-Identifier: Apache-2.0
"""Rows about who commands what: silence, nonsense, a second one, clocks, stop, and what the actuators can bear."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import serial
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock as ClockMessage

from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until
from tests.failures.link_failures import last_line
from tests.failures.rig import MID, STRUTS, Rig, percentile, stretched
from tests.failures.scenario import Evidence, expect

STOP_LIMIT_MS = 50.0
STOPS = 10

BAD_MOTIONS: tuple[tuple[list[tuple[float, list[float]]], dict[str, object], str], ...] = (
    ([(4.0, stretched(1, 0.0451))], {}, "S1: stroke 45.1 mm at knot 1 is outside the limit 45 mm"),
    ([(1.0, [0.23] * 6), (9.0, stretched(6, -0.054))], {}, "S6: stroke -54 mm at knot 2 is outside the limit -45 mm"),
    ([(0.2, stretched(6, 0.006))], {}, "S6: speed 30 mm/s from 0.000 to 0.200 s is outside the limit 20 mm/s"),
    ([(1.0, stretched(1, float("nan")))], {}, "S1 is nan at knot 1"),
    ([(1.0, [0.235] * 6)], {"names": ["S1"] * 6}, "valid are ['S1', 'S2', 'S3', 'S4', 'S5', 'S6'], each once"),
    ([(1.0, [0.235] * 5)], {}, "valid"),
    ([(1.0, [0.235] * 6)], {"age_s": 2.0}, "s old, valid is within 0.5 s"),
    ([], {}, "valid"),
    ([(6.0, [0.234 - 0.045] * 6)], {}, "is not permitted"),
)
"""Knots, more words, and why they are refused."""


def silent_commander(lab: Rig) -> Evidence:
    """Row 6."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    motion = operator.begin_motion((20.0, stretched(1, 0.04)), lease=lab.arm())
    operator.moves(motion, 0.001)
    operator.lease = ""
    operator.sees(BridgeState.HOLD, 10.0)
    result = operator.end(motion).result
    expect(not result.success, "the motion went on")
    evidence.says(result.reason, "operator was silent for more than 1 s; arm again")
    began = operator.now_ns()
    expect(not operator.wrote_since(began), "the struts were not left alone")
    return evidence


def bad_motions(lab: Rig) -> Evidence:
    """Row 7."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lease = lab.arm()
    began = operator.now_ns()
    for knots, options, why in BAD_MOTIONS:
        result = operator.move(*knots, lease=lease, **options)
        expect(not result.success and why in result.reason, f"expected {why!r} in {result.reason!r}")
    evidence.told = [BAD_MOTIONS[0][2], result.reason.partition(" (")[0]]
    expect(not operator.wrote_since(began), "a refused motion moved something")
    expect(operator.bridge.state == BridgeState.ARMED, "a refusal changed the state")
    return evidence


def second_ones(lab: Rig) -> Evidence:
    """Row 9."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lease = lab.arm("first")
    elsewhere = lab.processes.node("hardware_bridge", "--ros-args", "-r", "__ns:=/another", port=lab.link)
    evidence.says(last_line(elsewhere, 1), "another bridge drives robot")
    try:
        serial.Serial(str(lab.link), exclusive=True).close()
        expect(False, "another program could open the port")
    except serial.SerialException:
        pass
    refused = operator.call("bridge/arm", Arm.Request(holder="second", lifted_and_clear=True))
    evidence.says(refused.message, "first holds the lease; disarm first")
    began = operator.now_ns()
    result = operator.move((2.0, stretched(1, 0.01)), lease="0123456789abcdef")
    evidence.says(result.reason, "first holds another one")
    expect(not operator.wrote_since(began), "a stranger moved something")
    expect(operator.move((2.0, stretched(1, 0.01)), lease=lease).success, "the first commander was disturbed")
    expect(operator.move((2.0, list(MID)), lease=lease).success, "the way back")
    return evidence


def other_clocks(lab: Rig) -> Evidence:
    """Row 10."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lab.end_bridge()
    evidence.says(last_line(lab.processes.node("hardware_bridge", use_sim_time=True), 1), "use_sim_time is true")
    lab.start_bridge()
    clock = operator.node.create_publisher(ClockMessage, "/clock", 10)
    seconds = [1e6]

    def tick() -> None:
        seconds[0] += 0.05
        clock.publish(ClockMessage(clock=Time(sec=int(seconds[0]), nanosec=int(seconds[0] % 1.0 * 1e9))))

    timer = operator.node.create_timer(0.05, tick)
    try:
        lease = lab.arm()
        stale = operator.move((8.0, stretched(1, 0.02)), lease=lease, age_s=operator.now_ns() * 1e-9 - seconds[0])
        evidence.says(stale.reason, "s old, valid is within 0.5 s; check clocks")
        for jump_s in (3600.0, -7200.0, 86_400.0):
            seconds[0] += jump_s
            operator.hears_more(20)
            expect(operator.bridge.state == BridgeState.ARMED, f"a jump of the clock: {operator.bridge.reason}")
        operator.lease = ""
        operator.sees(BridgeState.HOLD, 10.0)
        evidence.says(operator.bridge.reason, "was silent for more than 1 s")
    finally:
        operator.in_executor(partial(operator.node.destroy_timer, timer))
        operator.in_executor(partial(operator.node.destroy_publisher, clock))
    return evidence


_REHEARSE = """
from sixstrut_cli.app import run
while run(["rehearse", "--from", "TC6"]) == 0:
    pass
"""


@contextmanager
def rehearsing(lab: Rig) -> Iterator[None]:
    """Rehearsals one after the other, on all cores, while the block lasts; it begins after the first."""
    log = lab.folder / "rehearsal.log"
    with log.open("w") as output:
        child = subprocess.Popen(
            [sys.executable, "-c", _REHEARSE],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    try:
        wait_until(lambda: log.stat().st_size or child.poll() is not None, 120.0, "the first rehearsal")
        expect(child.poll() is None, f"the rehearsal ended: {log.read_text()}")
        yield
    finally:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def stop_times_ms(lab: Rig, count: int) -> list[float]:
    """For so many stops in mid-motion: from the call until the last bytes that could move anything were handed over, in ms."""
    operator = lab.operator
    times_ms = []
    for number in range(count):
        lease = lab.arm()
        target = stretched(1, 0.02 if number % 2 == 0 else -0.02)
        motion = operator.begin_motion((40.0, target), lease=lease)
        heard = len(operator.sent)
        operator.hears_more(4)
        called_ns = operator.trigger_at("stop")
        operator.lease = ""
        expect(not operator.end(motion).result.success, "the motion went on after stop")
        expect(operator.wrote_since(called_ns), "nothing was sent to hold the struts")
        last_ns = max(operator.stamp_ns(m) for m in operator.sent[heard:] if not m.heartbeat)
        times_ms.append((last_ns - called_ns) * 1e-6)
        operator.sees(BridgeState.FAULT)
        expect(operator.trigger("reset").success, "reset")
    return times_ms


def stop_pressed(lab: Rig) -> Evidence:
    """Row 14."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    with rehearsing(lab):
        times_ms = stop_times_ms(lab, STOPS)
        lease = lab.arm()
        operator.trigger("stop")
        operator.sees(BridgeState.FAULT)
        refused = operator.move((2.0, stretched(1, 0.01)), lease=lease)
        evidence.says(refused.reason, "execute refused in state FAULT: stop pressed; remove the cause, then call reset")
        expect("FAULT: stop pressed" in lab.refused_arm(), "arm in FAULT")
    evidence.figures = {
        "stops under a rehearsal's load": STOPS,
        "stop to last bytes, median [ms]": round(percentile(times_ms, 0.5), 1),
        "stop to last bytes, largest [ms]": round(max(times_ms), 1),
    }
    expect(percentile(times_ms, 0.5) <= STOP_LIMIT_MS, f"half of the stops took longer than {STOP_LIMIT_MS:g} ms: {times_ms}")
    return evidence


def spent_actuators(lab: Rig) -> Evidence:
    """Row 15."""
    evidence = Evidence()
    operator = lab.use(STRUTS, duty_fraction=0.05, duty_window_s=60.0)
    lease = lab.arm()
    expect(operator.move((1.0, stretched(2, 0.01)), lease=lease).success, "a motion within the budget")
    refused = operator.move((2.5, stretched(2, 0.04)), lease=lease)
    evidence.says(refused.reason, "S2: has run", "the limit is 3 s; wait")
    expect(operator.move((1.0, list(MID)), lease=lease).success, "the way back to mid stroke")

    lab.fault("battery", volts=6.0)
    wait_until(lambda: operator.bridge.battery_v == 6.0, 15.0, "a low battery")
    low = operator.move((1.0, stretched(3, 0.01)), lease=lease)
    evidence.says(low.reason, "servo supply is 6.00 V, the limit is 6.4 V; charge it")
    lab.fault("clear")
    wait_until(lambda: operator.bridge.battery_v > 7.0, 15.0, "a new battery")

    lab.fault("stall", strut=4)
    away = stretched(4, 0.012)
    expect(operator.move((1.0, away), lease=lease).success, "no board tells a stall: the motion is sent whole")
    wait_until(lambda: "stalled" in operator.diagnostics["hardware_bridge: observer"].message, 15.0, "a stall in the diagnostics")
    stalled = operator.move((0.5, [*away[:5], 0.236]), lease=lease)
    evidence.says(stalled.reason, "S4 stands", "it has stalled")
    lab.fault("clear")
    wait_until(lambda: operator.move((0.5, [*away[:5], 0.232]), lease=lease).success, 10.0, "motion with the strut free again")
    lab.spoil()  # of another budget, nobody knows how much is spent
    return evidence
