# SPDX-License-Identifier: Apache-2.0
"""The shipped parameter files say what the nodes say of themselves."""

from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from tensegrity_robot.bridge.bridge_parameters import BridgeParameters
from tensegrity_robot.planner.gait_planner_node import PlannerParameters
from tensegrity_robot.planner.traveller_node import TravellerParameters
from tensegrity_robot.twin.twin_node import TwinParameters

CONFIG = Path(__file__).parents[3] / "ros_ws" / "src" / "tensegrity_robot" / "config"
NODES = {
    "twin": TwinParameters,
    "gait_planner": PlannerParameters,
    "traveller": TravellerParameters,
    "hardware_bridge": BridgeParameters,
}
SAYS = {
    "twin": "stands on TC6",
    "gait_planner": "library robust",
    "traveller": "goals on /goal_pose",
    "hardware_bridge": "virtual_prototype",
}


@pytest.mark.parametrize("node", NODES)
def test_a_parameter_file_holds_every_parameter_with_its_default(node):
    text = (CONFIG / f"{node}.yaml").read_text(encoding="utf-8")
    given = yaml.safe_load(text)[f"/**/{node}"]["ros__parameters"]
    assert given == {row.name: row.default for row in fields(NODES[node])}
    assert all(isinstance(given[row.name], type(row.default)) for row in fields(NODES[node]))
    for row in fields(NODES[node]):
        assert row.metadata["description"] in text


@pytest.mark.ros
@pytest.mark.parametrize("node", NODES)
def test_a_node_starts_with_its_parameter_file(node, processes):
    words = ("--ros-args", "--params-file", str(CONFIG / f"{node}.yaml"))
    process = processes.node(node, *words)
    process.says(SAYS[node])
    assert processes.stop() == {node: 0}
