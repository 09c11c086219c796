# SPDX-License-Identifier: Apache-2.0
"""An hour of robot time, rolls one after the other, with faults at random: nothing leaks, every roll is accounted for."""

import os
import random
import time
from collections import Counter
from pathlib import Path

import pytest

from hardware_bridge.prototype_client.fault_client import FROM_BOARD, TO_BOARD
from hardware_bridge.recording.bag_reader import read_session
from sim_core.structure.topology import NEIGHBOURS
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Disarm
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import wait_until
from tests.failures.documented import shape_of
from tests.failures.rig import Rig, Setup

pytestmark = [pytest.mark.soak, pytest.mark.ros, pytest.mark.timeout(3600)]

HOUR_NS = 3_600_000_000_000
SCALE = 10.0
LOOK_NS = 60_000_000_000
NODES = ("hardware_bridge", "gait_planner", "twin", "virtual_prototype")
FAULTS = (
    ("drop", TO_BOARD, {"count": 30}),
    ("drop", FROM_BOARD, {"count": 3}),
    ("corrupt", TO_BOARD, {"count": 20}),
    ("corrupt", FROM_BOARD, {"count": 6}),
    ("delay", TO_BOARD, {"seconds": 3.0}),
    ("delay", FROM_BOARD, {"seconds": 3.0}),
    ("extra", FROM_BOARD, {"count": 9}),
    ("cut", "", {}),
    ("stuck", "", {}),
    ("reset", "", {}),
    ("brown_out", "", {"volts": 5.0, "seconds": 10.0}),
    ("stall", "", {"strut": 3}),
)
CLOSE_LIMIT_S = 300.0
"""The bridge rewrites and reads back an hour's bag before it ends."""
LIMITS = {"memory [MB]": 25.0, "handles": 3.0, "threads": 2.0}
"""By how much the last third of the hour may exceed the second, in the middle."""


def cost(pid: int) -> dict[str, float]:
    """What a process holds now."""
    status = Path(f"/proc/{pid}/status").read_text()
    fields = dict(line.split(":", 1) for line in status.splitlines())
    return {
        "memory [MB]": int(fields["VmRSS"].split()[0]) / 1024,
        "handles": float(len(os.listdir(f"/proc/{pid}/fd"))),
        "threads": float(fields["Threads"]),
    }


def recovered(lab: Rig) -> bool:
    """No fault, no lease, then armed; whether that went well."""
    operator = lab.operator
    lab.fault("clear")
    operator.call("disarm", Disarm.Request())
    if operator.bridge.state == BridgeState.FAULT and not operator.trigger("reset").success:
        return False
    try:
        operator.arm()
    except StackError:
        return False
    return True


def one_roll(lab: Rig, rng: random.Random, outcomes: Counter[str]) -> None:
    """A roll, in one of three cases with a fault meanwhile; counts how it ended."""
    operator = lab.operator
    armed = operator.bridge.state == BridgeState.ARMED and bool(operator.bridge.lease_holder)
    if not armed and not recovered(lab):
        outcomes["not armed this time"] += 1
        return
    wait_until(lambda: operator.observed.settled or operator.bridge.state == BridgeState.FAULT, 60.0, "rest")
    face = operator.observed.face or "TC6"
    outcomes["asked"] += 1
    goal = operator.begin_roll(rng.choice(NEIGHBOURS[face]))
    assert goal.accepted
    fault = rng.choice(FAULTS) if rng.random() < 1 / 3 else None
    if fault is not None:
        outcomes["faults"] += 1
        operator.hears_more(rng.randrange(1, 40)) if operator.bridge.link_ok else None
        lab.fault(fault[0], fault[1], **fault[2])
    elif rng.random() < 0.1:
        outcomes["stops"] += 1
        operator.trigger("stop")
    result = operator.end(goal, 120.0).result
    outcomes["succeeded" if result.success else "failed"] += 1
    if not result.success:
        outcomes[f"because: {shape_of(result.reason)[:60]}"] += 1
    assert result.success or result.reason, "a roll that failed without a reason"
    if fault is not None:
        lab.fault("clear")


def test_an_hour_of_rolls_with_faults_leaks_nothing_and_loses_no_roll(lab, figure):
    rng, outcomes = random.Random(1), Counter()
    setup = Setup(time_scale=SCALE, prototype=("--seed", "5"), rolling=True)
    operator = lab.use(setup, duty_fraction=1.0)
    held: dict[str, list[dict[str, float]]] = {name: [] for name in NODES}
    began_ns = looked_ns = operator.bridge.robot_time_ns
    while (now_ns := operator.bridge.robot_time_ns) < began_ns + HOUR_NS:
        one_roll(lab, rng, outcomes)
        operator.sent[:-2000] = []  # our own memory
        if now_ns - looked_ns >= LOOK_NS:
            looked_ns = now_ns
            for name in NODES:
                assert lab.node(name).code is None, f"{name} ended: {lab.node(name).output}"
                held[name].append(cost(lab.node(name).pid))
    for name, rows in held.items():
        third = len(rows) // 3
        for what, limit in LIMITS.items():
            second, last = (sorted(row[what] for row in part)[third // 2] for part in (rows[third : 2 * third], rows[2 * third :]))
            figure(f"{name}: {what}, second and last third", f"{second:.1f}, {last:.1f}")
            assert last - second <= limit, f"{name}: {what} from {second} to {last}"
    assert outcomes["asked"] == outcomes["succeeded"] + outcomes["failed"]
    for what, count in outcomes.most_common():
        figure(f"rolls: {what}", count)
    bag = Path(operator.bridge.bag)
    began_s = time.monotonic()
    lab.end_bridge(CLOSE_LIMIT_S)
    figure("finishing the bag of the hour [s]", round(time.monotonic() - began_s, 1))
    session = read_session(bag)
    figure("messages in the bag of the hour", sum(map(len, session.messages.values())))
    numbers = sorted(message.seq for topic in ("bridge/struts_sent", "bridge/face") for message in session.of(topic))
    assert numbers == list(range(1, len(numbers) + 1)), "events are missing in the bag"
