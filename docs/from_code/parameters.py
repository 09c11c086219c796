# SPDX-License-Identifier: Apache-2.0
"""The page of parameters: of the nodes, of the launch file, of the robot's model, and of the actuators' model."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from docs.from_code import NOTE, table
from sim_core.dynamics import actuators
from sim_core.structure import parameters
from sim_core.structure.parameter_file import ParameterFile

HEAD = """\
## The nodes

Parameters are read at the start and cannot be changed while a node runs: `--ros-args -p NAME:=VALUE`, or a YAML file, as in
`ros_ws/src/tensegrity_robot/config/`. `ros2 param describe` tells the same."""

LAUNCH = """\
## The launch file

`ros2 launch tensegrity_robot tensegrity.launch.py NAME:=VALUE` takes these arguments, and checks all of them before anything
starts. `--show-args` lists them, too."""

MODEL = """\
## The robot's model

One YAML file holds every number, each with unit and source: `sim_core/sim_core/data/prototype.yaml`. To describe another robot,
copy it, change values and their sources, and give it with `--prototype FILE` or the nodes' `prototype_file`. *Stand-in* is our
engineering estimate, not a measurement; the page [model](../model.md) says what is computed from it."""

ACTUATORS = """\
## The actuators' model

Actuators that feel their load: `sim_core/sim_core/data/actuators.yaml`. The virtual prototype has them by default, the twin only
with `actuators:=stand-in`. Another file of the same form can be given in their place."""


def page(_: Path) -> str:
    """The page, as Markdown."""
    lines = ["# Parameters", "", NOTE, "", HEAD]
    for node, settings in _nodes().items():
        lines += [
            "",
            f"### {node}",
            "",
            *table(("parameter", "default", "valid", "means"), [_node_row(row) for row in fields(settings)]),
        ]
    lines += ["", LAUNCH, "", *table(("argument", "default", "means"), _launch_rows())]
    for text, file in ((MODEL, parameters.FILE), (ACTUATORS, actuators.FILE)):
        numbers = _model_rows(file)
        lines += ["", text, "", *table(("parameter", "value", "unit", "valid", "source", "means"), numbers)]
    return "\n".join(lines) + "\n"


def _nodes() -> dict[str, Any]:
    from tensegrity_robot.bridge.bridge_parameters import BridgeParameters
    from tensegrity_robot.planner.gait_planner_node import PlannerParameters
    from tensegrity_robot.planner.traveller_node import TravellerParameters
    from tensegrity_robot.twin.twin_node import TwinParameters

    return {
        "hardware_bridge": BridgeParameters,
        "gait_planner": PlannerParameters,
        "traveller": TravellerParameters,
        "twin": TwinParameters,
    }


def _launch_rows() -> list[tuple[str, str, str]]:
    from tensegrity_robot.ros.launch_arguments import ARGUMENTS

    return [(f"`{name}`", f"`{default}`" if default else "empty", text) for name, default, text in ARGUMENTS]


def _node_row(row: Any) -> tuple[str, str, str, str]:
    low, high, choices = row.metadata["low"], row.metadata["high"], row.metadata["choices"]
    default = str(row.default).lower() if isinstance(row.default, bool) else f"{row.default}"
    valid = {bool: "true, false", str: "text"}.get(type(row.default), "")
    if low is not None:
        valid = f"{low:g} to {high:g}"
    elif choices:
        valid = ", ".join(f"`{choice}`" for choice in choices)
    return f"`{row.name}`", f"`{default}`" if default else "empty", valid, row.metadata["description"]


def _model_rows(file: ParameterFile) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    given = {entry.name: entry for entry in file.load()}
    for name, spec in file.specs.items():
        entry = given[name]
        shown = ", ".join(f"{one:g}" for one in entry.value) if spec.size else f"{entry.value:.6g}"
        valid = (
            f"{spec.low:g} to {spec.high:g}" + (", whole" if spec.whole else "") + (f", {spec.size} of them" if spec.size else "")
        )
        rows.append((f"`{name}`", shown, spec.unit, valid, entry.source, entry.note))
    return rows
