# SPDX-License-Identifier: Apache-2.0
"""Rows about the session: its log, its end, its nodes, and whether what it is made of goes together."""

import re
import resource
import signal
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from hardware_bridge.recording.bag_on_disk import file_of, journal_of
from hardware_bridge.recording.bag_reader import Session, read_session
from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.bags.replay import ReplayError, model_of, require_same_model
from tensegrity_lab.stack.processes import wait_until
from tests.failures.link_failures import last_line
from tests.failures.rig import ROLLING, STRUTS, Rig, stretched
from tests.failures.scenario import Evidence, expect

ROOM_BYTES = 100_000


def log_fails(lab: Rig) -> Evidence:
    """Row 11."""
    evidence = Evidence()
    lab.use(STRUTS)
    lab.end_bridge()
    unwritable = lab.processes.node("hardware_bridge", bag_folder="/proc/sixstrut")
    evidence.says(last_line(unwritable, 1), "/proc/sixstrut", "give another bag_folder")
    lab.use(STRUTS, space_limit_mb=1e7)
    evidence.says(lab.refused_arm(), "MB are free in", "the limit is 10000000 MB (space_limit_mb): free space")
    operator = lab.use(STRUTS)
    lease = lab.arm()
    motion = operator.begin_motion((30.0, stretched(1, 0.04)), lease=lease)
    operator.moves(motion, 0.001)
    bridge, bag = lab.node("hardware_bridge"), Path(operator.bridge.bag)
    size = journal_of(bag).stat().st_size + ROOM_BYTES
    resource.prlimit(bridge.pid, resource.RLIMIT_FSIZE, (size, size))  # the kernel refuses what is beyond, as a full disk does
    result = operator.end(motion).result
    evidence.says(result.reason, "the log is dead", "File too large")
    operator.sees(BridgeState.HOLD)
    refused = operator.move((20.0, stretched(1, 0.04)), lease=lease)
    expect("the log is dead" in refused.reason, f"a motion without a log: {refused.reason}")
    wait_until(lambda: operator.diagnostics["hardware_bridge: log"].message == refused.reason, 5.0, "a dead log in the diagnostics")
    expect(operator.move((20.0, [0.234] * 6), lease=lease).success, "the way back to mid stroke")
    operator.lease = ""
    lab.end_bridge()
    expect(len(list(read_session(bag).of("bridge/struts_sent"))) > 0, "what was acknowledged is not there")
    return evidence


@dataclass(frozen=True)
class Killed:
    """What came after a bridge that was killed in mid-roll.

    Attributes:
        acknowledged: Messages that it had told as written.
        recovered: Messages in the bag that the next bridge made of its journal.
        mended: The next bridge's line about it.
        roll_ended: The roll's reason.
        refused: Why the next roll was refused.
    """

    acknowledged: int
    recovered: int
    mended: str
    roll_ended: str
    refused: str


def kill_bridge(lab: Rig) -> Killed:
    """Kills the bridge in mid-roll and starts another."""
    operator = lab.use(ROLLING)
    wait_until(lambda: operator.diagnosis("log"), 10.0, "the log's diagnostics")
    goal = lab.begin_roll()
    bag, bridge = Path(operator.bridge.bag), lab.node("hardware_bridge")
    acknowledged = int(operator.diagnosis("log")["messages"])
    bridge.signal(signal.SIGKILL)
    bridge.ends()
    ended = operator.end(goal).result
    expect(not ended.success, "a roll outlived the bridge")
    next_one = lab.start_bridge()
    expect(operator.bridge.state == BridgeState.DISARMED and not operator.bridge.lease_holder, "the bridge came back armed")
    refused = operator.roll("TO5").reason
    next_one.says(f"mended {bag}")
    line = next(line for line in next_one.output.splitlines() if f"mended {bag}" in line)
    recovered = int(re.findall(r": (\d+) messages", line)[0])
    session = read_session(bag)
    expect(sum(len(messages) for messages in session.messages.values()) == recovered, "the log does not read back")
    return Killed(acknowledged, recovered, line[line.index("mended") :], ended.reason, refused)


def killed_while_recording(lab: Rig) -> Evidence:
    """Row 12."""
    evidence = Evidence()
    killed = lab.remember("killed", lambda: kill_bridge(lab))
    expect(killed.recovered >= killed.acknowledged, f"{killed.acknowledged} messages acknowledged, {killed.recovered} recovered")
    evidence.says(killed.mended, "messages of a session that was cut short")
    evidence.figures = {"messages acknowledged": killed.acknowledged, "messages recovered": killed.recovered}
    return evidence


def signals_in_mid_gait(lab: Rig) -> Evidence:
    """Row 13."""
    evidence = Evidence()
    for numbers in ((signal.SIGINT, signal.SIGINT), (signal.SIGTERM, signal.SIGTERM)):
        operator = lab.use(ROLLING)
        lab.begin_roll()
        bag, bridge = Path(operator.bridge.bag), lab.node("hardware_bridge")
        for number in numbers:
            bridge.signal(number)
        expect(bridge.ends(10.0) == 0 and "Traceback" not in bridge.output, f"it ended with {bridge.code}: {bridge.output}")
        expect(file_of(bag).is_file() and not journal_of(bag).exists(), "the log is not finished")
        session = read_session(bag)
        writes = [message for message in session.of("bridge/struts_sent") if not message.heartbeat]
        earlier, before, last = (message.pulse_us for message in writes[-3:])
        held = all(min(a, b) - 1 <= pulse <= max(a, b) + 1 for a, b, pulse in zip(earlier, before, last, strict=True))
        expect(held, "the last frame does not hold the struts where the board is")
        expect(list(session.of("bridge/state"))[-1].state == BridgeState.DISARMED, "the last state is not DISARMED")
        lab.start_bridge()
    evidence.told.append("exit code 0; the log is closed, its last frame holds the struts, its last state is DISARMED")
    return evidence


def nodes_die(lab: Rig) -> Evidence:
    """Row 17."""
    evidence = Evidence()
    killed = lab.remember("killed", lambda: kill_bridge(lab))
    evidence.says(killed.refused, "the robot is not armed: ros2 service call /arm")

    operator = lab.use(ROLLING)
    lab.begin_roll()
    dead = operator.node.count_services("roll/_action/send_goal")
    lab.node("gait_planner").signal(signal.SIGKILL)
    lab.node("gait_planner").ends()
    operator.sees(BridgeState.HOLD, 10.0)
    evidence.says(operator.bridge.reason, "was silent for more than 1 s; arm again")
    lab.restart("gait_planner", settle_timeout_s=200.0)
    wait_until(lambda: operator.node.count_services("roll/_action/send_goal") > dead, 30.0, "the new planner")
    expect(not operator.roll("TO5").success, "the planner came back with a lease")

    lab.node("twin").signal(signal.SIGKILL)
    lab.node("twin").ends()
    operator.twin = None
    lab.restart("twin").says("the event stream")
    operator.wait_for_stack()
    goal = lab.begin_roll()
    operator.end(goal)
    return evidence


def what_does_not_go_together(lab: Rig) -> Evidence:
    """Row 18."""
    evidence = Evidence()
    operator = lab.use(STRUTS)
    lease = lab.arm()
    refused = operator.move((2.0, stretched(1, 0.01)), lease=lease, library_hash="0123456789abcdef")
    bag = Path(operator.bridge.bag)
    expect(not refused.success, "a motion from another library than the bag's")
    evidence.says(refused.reason, "comes from library 0123456789abcdef, this session's bag holds library", "the same library")
    operator.lease = ""
    lab.end_bridge()

    session = read_session(bag)
    facts = {**session.metadata["session"], "model": "v0 (0123456789abcdef)"}
    other = Session(session.path, session.messages, session.attachments, {**session.metadata, "session": facts})
    model = model_of(session)
    require_same_model(session, model)
    try:
        require_same_model(other, model)
        expect(False, "a bag of another model was replayed")
    except ReplayError as error:
        evidence.says(str(error), "recorded with model v0 (0123456789abcdef)", model.hash)

    file = lab.folder / "of_another_board.yaml"
    own = files("hardware_bridge") / "data" / "calibration_default.yaml"
    file.write_text(f"board: ssc32\n{own.read_text(encoding='utf-8')}", encoding="utf-8")
    mismatched = lab.processes.node("hardware_bridge", calibration=file)
    evidence.says(last_line(mismatched, 1), "board is lsc, but", "is for ssc32; set the board to ssc32")
    return evidence
