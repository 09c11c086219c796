# SPDX-License-Identifier: Apache-2.0
"""Rows about which robot is at the port, and whether one is there at all."""

import os
import signal
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from hardware_bridge.boards.lsc import CMD_BATTERY, FrameDecoder, encode_battery_reply
from hardware_bridge.calibration.calibration_file import load_calibration, text_of
from hardware_bridge.recording.bag_on_disk import journal_of
from sim_core.names import STRUT_NAMES
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until
from tests.failures.rig import FELT, MID, STRUTS, Rig
from tests.failures.scenario import Evidence, expect

DAMAGE = 4096
"""Bytes of zeros, a page of a disk."""


@contextmanager
def board(answers: bool) -> Iterator[str]:
    """A board that is no virtual prototype, behind a pty: its port. It answers whether it is alive, or says nothing at all."""
    near, far = os.openpty()
    tty.setraw(far)

    def listen() -> None:
        decoder = FrameDecoder()
        try:
            while data := os.read(near, 4096):
                asked = [frame for frame in decoder.feed(data) if frame.command == CMD_BATTERY]
                for _ in asked if answers else ():
                    os.write(near, encode_battery_reply(7400))
        except OSError:
            return  # the port is closed

    threading.Thread(target=listen, daemon=True).start()
    try:
        yield os.ttyname(far)
    finally:
        os.close(far)
        os.close(near)


def calibration_of(lab: Rig, robot: str, stroke_mm: float) -> Path:
    """A calibration of a robot: the virtual prototype's numbers, but for its name and how far its struts go."""
    known = load_calibration()
    struts = [replace(strut, stroke_mm=(-stroke_mm, stroke_mm)) for strut in known.struts]
    path = lab.folder / f"{robot}.yaml"
    path.write_text(text_of(robot, known.mid_stroke_length_m, dict(zip(STRUT_NAMES, struts, strict=True)), ""), encoding="utf-8")
    return path


def silent_board(lab: Rig) -> Evidence:
    """Row 22."""
    evidence = Evidence()
    lab.use(STRUTS)
    lab.end_bridge()
    with board(answers=False) as port, bridge_at(lab, port, calibration_of(lab, "silent", 48.0)):
        evidence.says(lab.refused_arm(), "has never answered on", "silent_board:=true")
    return evidence


def another_robot(lab: Rig) -> Evidence:
    """Row 23."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lab.end_bridge()
    with board(answers=True) as port:
        with bridge_at(lab, port, calibration_of(lab, "blue", 48.0)):
            answer = operator.call("bridge/arm", Arm.Request(holder="test", lifted_and_clear=True, confirmed_lengths_m=MID))
            expect(answer.success, f"a robot whose lengths are confirmed is not armed: {answer.message}")
        with bridge_at(lab, port, calibration_of(lab, "red", 47.0)):
            evidence.says(lab.refused_arm(), "red", "confirm")
    return evidence


def damaged_journal(lab: Rig) -> Evidence:
    """Row 24."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    operator.hears_more(2000)
    bag, bridge = Path(operator.bridge.bag), lab.node("hardware_bridge")
    wait_until(lambda: operator.bridge.bag_messages > 2000, 30.0, "messages in the log")
    acknowledged = int(operator.bridge.bag_messages)
    bridge.signal(signal.SIGKILL)
    bridge.ends()
    journal = journal_of(bag)
    with journal.open("r+b") as file:
        file.seek(journal.stat().st_size // 2)
        file.write(bytes(DAMAGE))
    again = lab.start_bridge()
    again.says("mended", 60.0)
    line = next(line for line in again.output.splitlines() if "mended" in line)
    kept = journal.with_name(journal.name + ".damaged")
    expect(kept.exists() and not journal.exists(), f"the damaged journal is not kept: {line}")
    evidence.says(line.partition(": ")[2], "mended", "damaged")
    evidence.figures = {"messages acknowledged": acknowledged, "bytes of zeros in the middle": DAMAGE}
    return evidence


def sensor_fails(lab: Rig) -> Evidence:
    """Row 25."""
    evidence = Evidence()
    operator = lab.use(FELT)

    def unknown(after: str, *wanted: str) -> None:
        seen = lambda: operator.observed.source == "imu" and not operator.observed.face  # noqa: E731
        operator.wait(seen, f"an unknown face after {after} (now {operator.observed})", 20.0)
        evidence.says(operator.observed.detail, *wanted)

    for fault, words in (("imu_unplugged", "no measurement came"), ("imu_frozen", "the same figures again and again")):
        roll = lab.begin_roll()
        lab.fault(fault)
        unknown(fault, words, "while the struts moved")
        lab.fault("clear")
        result = operator.end(roll, 90.0).result
        expect(result.success and result.observed_face, f"the face is not told when the sensor is back: {result.reason}")
        lab.calm()
    lab.fault("imu_turned", degrees=60.0)
    unknown("a turn", "Say the face when that is mended")
    operator.set_face(result.observed_face)
    operator.hears_more(100)
    expect(operator.observed.source == "operator", f"a sensor that was turned is believed: {operator.observed}")
    lab.spoil()
    return evidence


@contextmanager
def bridge_at(lab: Rig, port: str, calibration: Path) -> Iterator[None]:
    """A bridge at a port of its own, in place of the lab's, while the block lasts."""
    operator = lab.operator
    operator.bridge = None
    bridge = lab.processes.node("hardware_bridge", port=port, calibration=str(calibration))
    try:
        bridge.says("DISARMED, nothing moves")
        wait_until(lambda: operator.bridge is not None and operator.bridge.port == port, 30.0, "the bridge at the other port")
        expect(operator.bridge.state == BridgeState.DISARMED, "it is not disarmed")
        yield
    finally:
        bridge.signal(signal.SIGINT)
        bridge.ends()
