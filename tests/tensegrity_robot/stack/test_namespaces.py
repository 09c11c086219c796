# SPDX-License-Identifier: Apache-2.0
"""Two stacks on one machine, in one ROS domain: each in a namespace of its own."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from hardware_bridge.prototype_client.handshake import default_link
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from tensegrity_lab.stack.processes import wait_until
from tests.stack_operator import Operator

NAMESPACES = ("blue", "lab/red")


@pytest.fixture
def operators(processes: Any, domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Operator]]:
    """An operator of each stack, once all is there."""
    monkeypatch.setenv("SIXSTRUT_STATE_DIR", str(processes.folder / "state"))
    bridges = []
    for space in NAMESPACES:
        words = ("--ros-args", "-r", f"__ns:=/{space}")
        processes.node("virtual_prototype", "--link", str(default_link(space)), "--perturbation", "0", "--time-scale", "2")
        bridges.append(processes.node("hardware_bridge", *words, lease_silence_s=10.0))
        processes.node("gait_planner", *words, settle_timeout_s=200.0)  # of robot time, while other tests may keep the machine busy
        processes.node("twin", *words)
    with ExitStack() as ending:
        yield [ending.enter_context(closing(Operator(domain=domain, namespace=space))) for space in NAMESPACES]
    assert set(processes.stop().values()) == {0}, [bridge.output for bridge in bridges]


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(400)
def test_a_roll_in_one_namespace_does_not_move_the_other(operators: list[Operator], processes: Any) -> None:
    lengths = neutral_lengths(load_prototype()).tolist()
    for operator in operators:
        operator.wait_for_stack()
        operator.arm(lengths)
    blue, red = operators
    assert blue.bridge.port != red.bridge.port
    assert blue.bridge.session != red.bridge.session
    assert {name.partition(": ")[0] for name in blue.diagnostics} == {"blue/hardware_bridge", "lab/red/hardware_bridge"}
    wait_until(lambda: red.sent and max(abs(red.sent[-1].length_m - lengths)) < 0.001, 60.0, "the other one at mid stroke")
    before = len(red.sent)
    result = blue.roll("TO5")
    assert result.success, result.reason
    assert blue.observed.face == "TO5"
    assert red.observed.face == "TC6"
    assert red.twin.face == "TC6"
    assert all(sent.heartbeat for sent in red.sent[before:]), "nothing was written to the other board"
    assert len(red.sent) > before
    blue.disarm()
    red.disarm()
    processes.stop()
    assert len([path for path in processes.bags.iterdir() if path.is_dir()]) == len(NAMESPACES), "a bag each"
