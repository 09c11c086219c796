# SPDX-License-Identifier: Apache-2.0
"""Rows about messages that nobody of the stack sent: too long, too many, recorded, or of another bridge."""

import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from sim_core.structure.topology import NEIGHBOURS
from tensegrity_interfaces.msg import BridgeState, FaceObservation, StrutsSent
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import Process, wait_until
from tensegrity_robot.ros import qos
from tests.failures.rig import ROLLING, STRUTS, Rig, stretched
from tests.failures.scenario import Evidence, expect

REAL_TIME = replace(STRUTS, time_scale=1.0)
"""Frames every 50 ms, as a real robot gets them."""

MOST_FRAMES = 2
"""After a stop was called: one that was being written, and the one that holds."""

MOST_LATE_FRAMES = 5
"""So many in no try: what was seen on a computer that a flood keeps busy."""

MOST_TRIES = 3
"""A busy computer delays one stop now and then; a stop that waits in a line is late every time."""

POINTS = 300_000

FLOODS: dict[str, tuple[str, ...]] = {
    f"a goal of {POINTS} points": ("execute_struts", str(POINTS)),
    "a flood of bridge/lease": ("bridge/lease", "tensegrity_interfaces/msg/LeaseProof"),
    "a flood of twin/state": ("twin/state", "tensegrity_interfaces/msg/TwinState"),
    "a flood of goal_pose": ("goal_pose", "geometry_msgs/msg/PoseStamped"),
    "a flood of large twin/markers": ("twin/markers", "visualization_msgs/msg/MarkerArray", "100000"),
}
"""What is sent, and the words of `flood`."""


@contextmanager
def flood(lab: Rig, *words: str) -> Iterator[Process]:
    """Somebody says too much while the block lasts."""
    process = lab.processes.start("flood", [sys.executable, str(Path(__file__).with_name("flood.py")), *words])
    try:
        process.says("flooding")
        yield process
    finally:
        process.kill()


@contextmanager
def frozen(lab: Rig) -> Iterator[None]:
    """The bridge's node stands still, as it would while it reads something endless."""
    pid = lab.node("hardware_bridge").pid
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def stop_in_mid_motion(lab: Rig, load: Callable[[], Any]) -> tuple[float, int]:
    """Stops a motion under a load: time from the call to the last bytes in ms, and frames sent after the call."""
    operator = lab.operator
    lease = lab.arm()
    motion = operator.begin_motion((590.0, stretched(1, 0.04)), lease=lease)
    operator.hears_more(4)
    with load():
        called_ns = operator.trigger_at("stop")
    operator.lease = ""
    expect(not operator.end(motion).result.success, "the motion went on after stop")
    expect(operator.wrote_since(called_ns), "nothing was sent to hold the struts")
    after = [operator.stamp_ns(m) for m in operator.sent if not m.heartbeat and operator.stamp_ns(m) > called_ns]
    operator.sees(BridgeState.FAULT)
    expect(operator.trigger("reset").success, "reset")
    return max((stamp - called_ns for stamp in after), default=0) * 1e-6, len(after)


def stop_under_load(lab: Rig) -> Evidence:
    """Row 19."""
    evidence = Evidence()
    lab.use(REAL_TIME, duty_fraction=1.0)
    loads: dict[str, Callable[[], Any]] = {name: partial(flood, lab, *words) for name, words in FLOODS.items()}
    loads["a node that stands still"] = partial(frozen, lab)
    for name, load in loads.items():
        slowest_ms, frames, tries = 0.0, MOST_LATE_FRAMES, 0
        while frames > MOST_FRAMES and tries < MOST_TRIES:
            tries += 1
            took_ms, frames = stop_in_mid_motion(lab, load)
            expect(frames <= MOST_LATE_FRAMES, f"{frames} frames went out after stop, under {name}")
            slowest_ms = max(slowest_ms, took_ms)
        expect(frames <= MOST_FRAMES, f"{frames} frames went out after stop, in the best of {tries} tries under {name}")
        evidence.figures[f"stop to last bytes, under {name} [ms]"] = round(slowest_ms, 1)
        if tries > 1:
            evidence.figures[f"tries, under {name}"] = tries
    with flood(lab, "execute_struts", str(POINTS)) as sender:
        expect(sender.ends(60.0) == 0, "the goal was not answered")
    evidence.says(sender.output.splitlines()[-1], f"the trajectory has {POINTS} points", "send fewer")
    return evidence


@contextmanager
def player(domain: int, face: str, age_s: float) -> Iterator[None]:
    """A recording of another session is played under the live names while the block lasts: a robot on another face, in FAULT."""
    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("player", context=context)
    publishers = [
        node.create_publisher(BridgeState, "bridge/state", qos.LATCHED),
        node.create_publisher(FaceObservation, "bridge/face", qos.LATCHED),
        node.create_publisher(StrutsSent, "bridge/struts_sent", 100),
    ]
    ended = threading.Event()

    def play() -> None:
        seq = 10**6
        while not ended.wait(0.05):
            seq += 1
            messages = (
                BridgeState(state=BridgeState.FAULT, reason="recorded", session="recorded", port="recorded", time_scale=1.0),
                FaceObservation(face=face, source="operator", settled=True, seq=seq, robot_time_ns=10**15, session="recorded"),
                StrutsSent(seq=seq, robot_time_ns=10**15, length_m=[0.2] * 6, session="recorded"),
            )
            stamp_ns = node.get_clock().now().nanoseconds - round(age_s * 1e9)
            for publisher, message in zip(publishers, messages, strict=True):
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
                publisher.publish(message)

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        node.destroy_node()
        rclpy.shutdown(context=context)


def recording_played(lab: Rig) -> Evidence:
    """Row 20."""
    evidence = Evidence()
    operator = lab.use(ROLLING)
    wait_until(operator.is_quiet, 60.0, "rest on a face")
    face = operator.observed.face
    operator.arm()
    with player(lab.domain, "TO5" if face != "TO5" else "TC6", age_s=3600.0):
        lab.node("gait_planner").says("a recording is played here")
        began = operator.now_ns()
        goal = operator.begin_roll(NEIGHBOURS[face][0])
        result = operator.end(goal, 180.0).result
    expect(result.completed and result.face_sequence[0] == face, f"the recording misled the planner: {result.reason}")
    expect(operator.wrote_since(began), "the roll was not made")
    evidence.told.append("bridge states 3600 s old are ignored: a recording is played here, or clocks differ")
    return evidence


def second_bridge(lab: Rig) -> Evidence:
    """Row 21."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    state = lab.folder / "other"
    link = state / "prototype"
    other = lab.processes.node("virtual_prototype", "--link", str(link), "--time-scale", "8")
    try:
        other.says("ready")
        second = lab.processes.node("hardware_bridge", port=str(link), state_folder=str(state))
        expect(second.ends(60.0) == 1, f"the second bridge goes on: {second.output}")
        evidence.says(re.sub(r"^.*(another bridge)", r"\1", second.output.splitlines()[-1]), "answers to the same names")
        other.kill()
        wait_until(lambda: _armed(lab), 10.0, "the first bridge, armed once the other one is silent")
        expect(operator.move((2.0, stretched(1, 0.01)), lease=operator.lease).success, "the first bridge was disturbed")
    finally:
        other.kill()
    return evidence


def _armed(lab: Rig) -> bool:
    """Tries to arm the bridge itself; whether it is."""
    operator = lab.operator
    answer = operator.call("bridge/arm", Arm.Request(holder="operator", lifted_and_clear=True))
    if not answer.success:
        return False
    operator.lease = answer.lease
    operator.sees(BridgeState.ARMED)
    return True
