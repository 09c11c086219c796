# SPDX-License-Identifier: Apache-2.0
"""Rows about the port and the line: missing, lost, cut, garbled, slow."""

import os
import signal
import tty
from collections.abc import Callable

import serial

from hardware_bridge.prototype_client.fault_client import FROM_BOARD, TO_BOARD
from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.stack.processes import Process, wait_until
from tests.failures.rig import MID, ROLLING, STRUTS, Rig, stretched
from tests.failures.scenario import Evidence, expect

START_LIMIT_S = 20.0
LOST_LIMIT_S = 10.0


def last_line(process: Process, code: int, limit_s: float = START_LIMIT_S) -> str:
    """The only line of a process that must end with a code."""
    ended = process.ends(limit_s)
    lines = [line for line in process.output.splitlines() if line.strip()]
    expect(ended == code and len(lines) == 1, f"{process.name} ended with {ended}, not {code}: {process.output}")
    return lines[0]


def bad_port(lab: Rig) -> Evidence:
    """Row 1."""
    evidence = Evidence()
    near, far = os.openpty()
    tty.setraw(far)
    taken = serial.Serial(os.ttyname(far), exclusive=True)
    try:
        started = [lab.processes.node("hardware_bridge", port=port) for port in ("/dev/nothing_here", os.ttyname(far), "/dev/null")]
        wanted = ("does not exist; start the virtual prototype", "is in use; stop the other program", "is no serial port")
        for process, part in zip(started, wanted, strict=True):
            evidence.says(last_line(process, 1), "error: port ", part)
    finally:
        taken.close()
        os.close(near)
        os.close(far)
    return evidence


def lost_in_mid_gait(lab: Rig) -> Evidence:
    """Row 2."""
    evidence = Evidence()
    operator = lab.use(ROLLING)
    lease = lab.arm()
    motion = operator.begin_motion((30.0, stretched(1, 0.04)), lease=lease)
    operator.moves(motion, 0.002)
    lab.fault("drop", TO_BOARD)
    operator.sees(BridgeState.FAULT, LOST_LIMIT_S)
    evidence.says(operator.end(motion).result.reason, "the board has not answered for 4 s", "then reset")
    lab.fault("clear")
    frames = lab.frames_sent()
    refused = operator.move((2.0, stretched(1, 0.01)), lease=lease)
    expect("FAULT" in refused.reason, f"a motion in FAULT: {refused.reason}")
    expect(operator.bridge.state == BridgeState.FAULT and lab.frames_sent() == frames, "it went on by itself")
    operator.lease = ""
    expect(operator.trigger("reset").success, "reset was refused")

    goal = lab.begin_roll()
    lab.node("virtual_prototype").signal(signal.SIGKILL)
    operator.sees(BridgeState.FAULT, LOST_LIMIT_S)
    result = operator.end(goal).result
    expect(not result.success and operator.bridge.reason in result.reason, f"a roll over a dead link: {result.reason}")
    lab.spoil()
    return evidence


def cut_and_blocked(lab: Rig) -> Evidence:
    """Row 4."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lease = lab.arm()
    motion = operator.begin_motion((3.0, stretched(1, 0.02)), lease=lease)
    operator.moves(motion, 0.002)
    lab.fault("stuck")
    operator.sees(BridgeState.FAULT, LOST_LIMIT_S)
    evidence.says(operator.end(motion).result.reason, "took 0 of", "bytes in time")
    expect(operator.bridge.write_errors > 0, "the failed write was not counted")
    lab.fault("clear")
    answer = operator.trigger("reset")
    expect(answer.success, f"reset: {answer.message}")
    lease = lab.arm()
    motion = operator.begin_motion((3.0, stretched(1, 0.02)), lease=lease)
    operator.moves(motion, 0.002)
    lab.fault("cut")
    expect(operator.end(motion).result.success, "a motion did not outlive one cut frame")
    expect(operator.move((3.0, list(MID)), lease=lease).success, "the way back")
    evidence.figures["failed writes counted"] = operator.bridge.write_errors
    return evidence


def garbled_answers(lab: Rig) -> Evidence:
    """Row 5."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lab.arm()
    wait_until(lambda: operator.bridge.battery_v > 0.0, 10.0, "the supply's voltage")
    told_v = operator.bridge.battery_v

    def count(key: str) -> int:
        return int(operator.diagnosis("link").get(key, 0))

    def more_than(bad: int) -> Callable[[], bool]:
        return lambda: count("bad replies") > bad

    wait_until(lambda: operator.diagnosis("link"), 10.0, "diagnostics")
    for fault, numbers in {"drop": {"count": 2}, "corrupt": {"count": 6}, "extra": {"count": 9}}.items():
        bad = count("bad replies")
        lab.fault(fault, FROM_BOARD, **numbers)
        if fault != "extra":  # what is left over from before a question is dropped, and needs no second one
            wait_until(more_than(bad), 10.0, f"a reply counted as bad ({fault})")
    lab.fault("delay", FROM_BOARD, seconds=6.0)  # of robot time
    late = count("questions asked")
    wait_until(lambda: count("questions asked") >= late + 2, 10.0, "late answers")
    lab.fault("clear")
    expect(operator.bridge.state == BridgeState.ARMED, f"bad answers ended in {operator.bridge.state}: {operator.bridge.reason}")
    expect(operator.bridge.battery_v == told_v, f"a bad answer was believed: {operator.bridge.battery_v} V")
    link = operator.diagnosis("link")
    evidence.says(f"/diagnostics, link: bad replies {link['bad replies']}, questions asked again {link['questions asked again']}")
    return evidence


def slow_link(lab: Rig) -> Evidence:
    """Row 16."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lease = lab.arm()
    motion = operator.begin_motion((16.0, stretched(1, 0.04)), lease=lease)
    operator.moves(motion, 0.002)
    lab.fault("delay", TO_BOARD, seconds=6.0)  # of robot time: 0.75 s of ours, late but before the next question
    wait_until(lambda: int(operator.diagnosis("frames").get("congested periods", 0)) > 0, 15.0, "frames held back")
    frames = operator.diagnostics["hardware_bridge: frames"]
    wait_until(lambda: float(operator.diagnosis("link")["latency of replies, largest [ms]"]) > 500.0, 10.0, "a late reply told")
    lab.fault("clear")
    expect(operator.end(motion).result.success, "the motion did not go on with the link")
    link = operator.diagnosis("link")
    evidence.says(f"/diagnostics, frames: {frames.message}", "held back because the link was slow")
    evidence.figures = {
        "periods without a frame": float(operator.diagnosis("frames")["congested periods"]),
        **{f"latency of replies, {part} [ms]": float(link[f"latency of replies, {part} [ms]"]) for part in ("median", "largest")},
    }
    expect(operator.move((16.0, list(MID)), lease=lease).success, "the way back")
    return evidence
