# SPDX-License-Identifier: Apache-2.0
"""The shipped parameter files and `--help` say what the nodes are; what a node does not have is refused."""

import re
import subprocess
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from docs.from_code import interfaces
from tensegrity_lab.stack.processes import executable
from tensegrity_robot.bridge.bridge_parameters import BridgeParameters
from tensegrity_robot.bridge.hardware_bridge_node import ABOUT as BRIDGE
from tensegrity_robot.imu.face_estimator_node import ABOUT as ESTIMATOR
from tensegrity_robot.imu.face_estimator_node import EstimatorParameters
from tensegrity_robot.imu.imu_driver_node import ABOUT as DRIVER
from tensegrity_robot.imu.imu_driver_node import DriverParameters
from tensegrity_robot.planner.gait_planner_node import ABOUT as PLANNER
from tensegrity_robot.planner.gait_planner_node import PlannerParameters
from tensegrity_robot.planner.traveller_node import ABOUT as TRAVELLER
from tensegrity_robot.planner.traveller_node import TravellerParameters
from tensegrity_robot.ros.node_process import VARIABLES
from tensegrity_robot.twin.twin_node import ABOUT as TWIN
from tensegrity_robot.twin.twin_node import TwinParameters

SOURCES = Path(__file__).parents[3] / "ros_ws" / "src"
CONFIG = SOURCES / "tensegrity_robot" / "config"
NODES = {
    "twin": TwinParameters,
    "gait_planner": PlannerParameters,
    "traveller": TravellerParameters,
    "hardware_bridge": BridgeParameters,
    "imu_driver": DriverParameters,
    "face_estimator": EstimatorParameters,
}
SAYS = {
    "twin": "stands on TC6",
    "gait_planner": "library robust",
    "traveller": "goals on /goal_pose",
    "hardware_bridge": "virtual_prototype",
    "imu_driver": "trying again each second",
    "face_estimator": "measurements on /imu/data",
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


def ended(node: str, *words: str) -> subprocess.CompletedProcess[str]:
    """A node that ends by itself."""
    command = [executable("tensegrity_robot", node), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.ros
@pytest.mark.parametrize("node", [*NODES, "virtual_prototype"])
def test_help_is_printed_and_nothing_starts(node):
    told = ended(node, "--help")
    assert (told.returncode, told.stderr) == (0, "")
    assert all(row.name in told.stdout for row in (fields(NODES[node]) if node in NODES else ()))
    assert node in told.stdout.splitlines()[0]


def test_help_names_what_the_nodes_sources_use():
    uses = interfaces._uses(SOURCES)
    for about in (BRIDGE, TWIN, PLANNER, TRAVELLER, DRIVER, ESTIMATOR):
        assert about.settings is NODES[about.name]
        for told, gives in ((about.gives, True), (about.takes, False)):
            own = {use for use in uses if use.node.removesuffix("_stop") == about.name and use.gives == gives}
            assert set(told.split()) == {use.name + ("" if "/msg/" in use.type_name else "()") for use in own}


@pytest.mark.ros
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--ros-args", "-p", "rate:=1.0"], "unknown parameter rate: did you mean rate_hz? `twin --help` lists all"),
        (["--ros-args", "--params-file", "FILE"], "unknown parameter frames: did you mean frame? `twin --help` lists all"),
        (
            ["--port", "x"],
            "twin does not know '--port': parameters are given as --ros-args -p NAME:=VALUE; `twin --help` lists them",
        ),
        (["--ros-args", "-p", "rate_hz=1.0"], "Couldn't parse parameter override rule: '-p rate_hz=1.0'"),
        (["--ros-args", "--bogus"], "ROS does not know the arguments ['--bogus']"),
    ],
)
def test_what_a_node_does_not_have_is_refused_in_one_line(tmp_path, words, line):
    file = tmp_path / "mine.yaml"
    file.write_text("/**/twin: {ros__parameters: {frames: odom}}\n/**/other: {ros__parameters: {x: 1}}\n", encoding="utf-8")
    told = ended("twin", *(str(file) if word == "FILE" else word for word in words))
    assert told.returncode == 1
    assert told.stderr.count("\n") == 1
    assert line in told.stderr


def test_the_variables_of_the_stack_are_those_that_its_sources_name():
    root = SOURCES.parents[1]
    files = [file for folder in ("hardware_bridge", "sim_core", "ros_ws/src", "tooling") for file in (root / folder).rglob("*.py")]
    texts = [file.read_text(encoding="utf-8") for file in [*files, root / "sixstrut"]]
    assert set(re.findall(r"SIXSTRUT_[A-Z_]+\b", "\n".join(texts))) == set(VARIABLES)


@pytest.mark.ros
def test_a_variable_s_typo_is_told(processes):
    process = processes.node("twin", environ={"SIXSTRUT_BAG": "x"})
    process.says("warning: unknown variable SIXSTRUT_BAG: did you mean SIXSTRUT_BAGS?")
    process.says(SAYS["twin"])


@pytest.mark.ros
def test_what_every_node_of_ros_has_is_taken(processes):
    words = ("--ros-args", "-p", "use_sim_time:=false", "-p", "start_type_description_service:=false")
    processes.node("twin", *words, "-p", "qos_overrides./tf.publisher.depth:=5").says(SAYS["twin"])
