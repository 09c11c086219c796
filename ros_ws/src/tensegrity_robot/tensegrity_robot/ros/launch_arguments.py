# SPDX-License-Identifier: Apache-2.0
"""What the launch file is given: checked as a whole before anything starts. A mistake found later would leave processes behind."""

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from hardware_bridge.boards.registry import SERVO_BOARD, parse_board
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import BridgeError
from hardware_bridge.recording.session_bag import bag_folder
from sim_core.errors import SimError
from sim_core.files.places import folder_problem
from sim_core.files.yaml_reader import read_yaml
from sim_core.gaits.library import load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.sensing.mounting import load_mounting
from sim_core.structure.topology import require_face
from sim_core.uncertainty.perturbation_law import MAX_INCLINE_DEG, MAX_SCALE
from tensegrity_robot.ros.errors import StartError, require_known

ARGUMENTS = (
    ("namespace", "", "namespace of all nodes, such as blue: so that several stacks run side by side"),
    ("params_file", "", "YAML of the nodes' parameters, as ROS takes it; arguments given here go before it"),
    ("virtual", "true", "start a virtual prototype and drive it; false: drive the board at `port`"),
    ("port", "", "device or socket://HOST:PORT of the board; empty: the virtual prototype's link"),
    ("board", "lsc", SERVO_BOARD),
    ("perturbation", "0.05", "how far the virtual prototype is off the nominal robot, 0.05 for ±5 %"),
    ("incline", "0.0", "incline of the virtual prototype's ground in degrees, downhill in a direction that the seed draws"),
    ("seed", "0", "draws the virtual prototype's true parameters"),
    ("time_scale", "1.0", "robot seconds per second; other than 1 only with a virtual prototype"),
    ("start_face", "TC6", "face on which robot and twin start"),
    ("calibration", "", "calibration YAML; empty: the virtual prototype's"),
    ("rested_s", "0.0", "how long the actuators have rested, in s, where nobody else knows it"),
    ("silent_board", "false", "the operator's word: this board cannot answer; arm it all the same"),
    ("library", "robust", "gait library: a shipped name, or a YAML file"),
    ("bags", "", "folder for the recorded bags; empty: $SIXSTRUT_BAGS or ./bags"),
    (
        "imu",
        "",
        "an inertial sensor in the box tells the faces, and no virtual observer does: wt901, with its driver; topic, with another "
        "driver on imu/data; empty: there is none",
    ),
    ("imu_port", "", "its device or socket://HOST:PORT; empty: the virtual prototype's"),
    ("mounting", "", "YAML of how it sits, from `sixstrut calibrate imu`; empty: its axes are the box's"),
    ("rviz", "false", "start RViz with the twin"),
)
"""Name, default, description."""

SENSORS = NONE, WT901, TOPIC = "", "wt901", "topic"
PARAMETERS = "ros__parameters"
LONGEST_SEED = 2**31 - 1
LONGEST_REST_S = 1e6
NAMESPACE = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
LONGEST_NAMESPACE = 40
"""Its prototype's sockets have it in their names, which may have about 100 characters."""
ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides")
"""Parameters that every node has."""
_WORDS = {"true": True, "1": True, "false": False, "0": False}


def require_arguments(given: Mapping[str, str], prefix_of: Callable[[str], str], config: Path) -> None:
    """Raises StartError: something that cannot be, with what is valid.

    Args:
        given: every one of `ARGUMENTS`, and whatever else was given, which is refused with the nearest name.
        prefix_of: where a package is installed; raises LookupError (ament's `get_package_prefix`).
        config: folder of the nodes' parameter files, NODE.yaml.
    """
    known = [name for name, _, _ in ARGUMENTS]
    require_known("argument", given, known, f"Valid are {', '.join(known)}")
    space = given["namespace"].strip("/")
    if space and (not NAMESPACE.fullmatch(space) or "__" in space or len(space) > LONGEST_NAMESPACE):
        valid = f"letters, digits and single _, parts separated by /, at most {LONGEST_NAMESPACE} in all, such as blue or lab/blue"
        raise StartError(f"namespace:={given['namespace']}: valid are {valid}")
    if given["params_file"]:
        _require_parameters(Path(given["params_file"]), config)
    virtual = truth(given, "virtual")
    port = given["port"]
    if virtual and port:
        raise StartError(f"port:={port} is a real robot's: give virtual:=false with it")
    if not virtual and not port:
        raise StartError("virtual:=false needs the board's port, such as port:=/dev/rfcomm0")
    if port and "://" not in port and not os.path.exists(port):  # noqa: PTH110 (no error where it may not be looked at)
        raise StartError(f"port:={port} does not exist: power the robot and bind its Bluetooth, or plug its cable in")
    scale = _number(given, "time_scale", 0.01, 100.0)
    if not virtual and scale != 1.0:
        raise StartError(f"time_scale:={given['time_scale']}: a real robot's is 1")
    _number(given, "rested_s", 0.0, LONGEST_REST_S)
    truth(given, "silent_board")
    _number(given, "perturbation", 0.0, MAX_SCALE)
    _number(given, "incline", 0.0, MAX_INCLINE_DEG)
    if not given["seed"].isdecimal() or int(given["seed"]) > LONGEST_SEED:
        raise StartError(f"seed:={given['seed']}: valid is a whole number from 0 to {LONGEST_SEED}")
    _require_sensor(given, virtual)
    try:
        require_face(given["start_face"])
        parse_board(given["board"])
        load_calibration(given["calibration"] or None)
        load_success_counts(load_library(given["library"]))
    except (BridgeError, SimError, OSError) as error:
        raise StartError(str(error)) from error
    _require_bags(bag_folder(given["bags"]))
    if truth(given, "rviz"):
        _require_rviz(prefix_of)


def _require_sensor(given: Mapping[str, str], virtual: bool) -> None:
    imu, port, mounting = (given[name] for name in ("imu", "imu_port", "mounting"))
    if imu not in SENSORS:
        raise StartError(f"imu:={imu}: valid are {', '.join(filter(None, SENSORS))}, or nothing")
    if (port or mounting) and not imu:
        raise StartError("imu_port and mounting are of an inertial sensor: give imu:=wt901, or imu:=topic, too")
    if port and (imu == TOPIC or virtual):
        raise StartError(
            f"imu_port:={port}: {'another driver has the port' if imu == TOPIC else 'the virtual prototype has its own'}"
        )
    if port and port == given["port"]:
        raise StartError(f"imu_port:={port} is the board's port: give each its own")
    if imu == WT901 and not (virtual or port):
        raise StartError("imu:=wt901 needs the sensor's port, such as imu_port:=/dev/ttyUSB1")
    try:
        load_mounting(mounting) if mounting else None
    except SimError as error:
        raise StartError(str(error)) from error


def truth(given: Mapping[str, str], name: str) -> bool:
    """A yes or no. Raises StartError."""
    word = given[name].strip().lower()
    if word not in _WORDS:
        raise StartError(f"{name}:={given[name]}: valid is true or false")
    return _WORDS[word]


def _require_parameters(file: Path, config: Path) -> None:
    """Raises StartError: it cannot be read, or names a node or parameter that the stack does not have."""
    try:
        known = {own.stem: {*_names(read_yaml(own)), *ROS_OWN} for own in config.glob("*.yaml")}
        document = read_yaml(file)
    except OSError as error:
        raise StartError(f"params_file:={file} cannot be read: {error.strerror}") from error
    except SimError as error:
        raise StartError(str(error)) from error
    for node, names in _blocks(document, file):
        if node:
            require_known("node", [node], known, f"Valid in {file} are {', '.join(sorted(known))}")
        for own in [node] if node else sorted(known):
            require_known(f"parameter of {own}", names, known[own], f"`ros2 run tensegrity_robot {own} --help` lists them ({file})")


def _names(document: Any) -> set[str]:
    return {name for _, names in _blocks(document, Path()) for name in names}


def _blocks(document: Any, file: Path, node: str = "") -> Iterator[tuple[str, set[str]]]:
    """Node, empty for all, and names of the parameters that are set for it. Raises StartError."""
    if not isinstance(document, Mapping) or not document:
        raise StartError(f"params_file:={file} is no parameter file: valid is NODE: {{ros__parameters: {{NAME: VALUE}}}}")
    for key, value in document.items():
        if key != PARAMETERS:
            yield from _blocks(value, file, key.rpartition("/")[2].strip("*") or node)
        elif isinstance(value, Mapping):
            yield node, {name.partition(".")[0] for name in value}


def _number(given: Mapping[str, str], name: str, low: float, high: float) -> float:
    try:
        value = float(given[name])
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise StartError(f"{name}:={given[name]}: valid is a number from {low:g} to {high:g}")
    return value


def _require_bags(folder: Path) -> None:
    if problem := folder_problem(folder, locks=True):
        raise StartError(f"bags:={problem}: give another folder")
    folder.mkdir(parents=True, exist_ok=True)


def _require_rviz(prefix_of: Callable[[str], str]) -> None:
    try:
        program = Path(prefix_of("rviz2")) / "lib" / "rviz2" / "rviz2"
    except LookupError as error:
        raise StartError("rviz:=true, but rviz2 is not installed: install it, or leave rviz:=true out") from error
    if not os.access(program, os.X_OK):
        raise StartError(f"rviz:=true, but {program} cannot be run: install rviz2, or leave rviz:=true out")
