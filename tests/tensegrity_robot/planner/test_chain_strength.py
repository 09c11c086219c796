# SPDX-License-Identifier: Apache-2.0
"""A chain without enough duty for the rest of its way ends in neutral."""

from dataclasses import replace

import pytest

from sim_core.gaits.cycle import TURNS, Cycle, CycleStage, Switches, faces_of
from sim_core.gaits.library import library_text, load_library
from sim_core.structure.topology import NEIGHBOURS
from tensegrity_interfaces.action import Roll
from tensegrity_lab.stack.client import StackClient

pytestmark = [pytest.mark.ros, pytest.mark.slow]
STAGES = CycleStage((7, 44, -19, -17, -45, -45), 0.0, 4.64), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.82)


def test_a_chain_ends_in_neutral_before_duty_is_spent(processes, domain, tmp_path):
    library = tmp_path / "chain.yaml"
    library.write_text(
        library_text(replace(load_library("robust"), cycles=(Cycle("C1", STAGES, {TURNS[0]: Switches(0, 0, 0, 0)}),)))
    )
    prototype = processes.node("virtual_prototype", "--time-scale", "4", "--perturbation", "0", "--actuators", "ideal")
    processes.node("twin")
    processes.node("gait_planner", library=str(library), rehearse_members=0)
    processes.node("hardware_bridge", lease_silence_s=10.0, burst_fraction=0.34, library=str(library))
    prototype.says("ready")
    operator = StackClient(domain=domain, events=True)
    try:
        operator.wait_for_stack()
        operator.arm()
        source = operator.observed.face
        faces = faces_of(source, NEIGHBOURS[source][0], [TURNS[0]] * 8)
        handle = operator.send(operator._roll, Roll.Goal(faces=list(faces[1:])), "roll", lambda _: None)
        result = operator.end(handle).result
        assert not result.success
        assert "the struts may run for" in result.reason
        assert 1 <= result.rolls < len(faces) - 1
        assert list(operator.bridge.length_m) == pytest.approx([0.234] * 6, abs=2e-4)
        assert operator.bridge.duty_left_s > 0.0
    finally:
        operator.close()
