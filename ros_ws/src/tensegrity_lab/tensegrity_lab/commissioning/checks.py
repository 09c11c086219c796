# SPDX-License-Identifier: Apache-2.0
"""What must be well before a robot moves, one check each, and how to mend what is not. Nothing here moves or changes anything."""

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from hardware_bridge.boards.board import Board
from hardware_bridge.calibration.calibration_file import Unfinished, load_calibration
from hardware_bridge.errors import BridgeError
from hardware_bridge.prototype_client import handshake as virtual_port
from hardware_bridge.prototype_client.handshake import default_link
from hardware_bridge.recording.bag_on_disk import journals_in
from hardware_bridge.recording.session_bag import bag_folder
from hardware_bridge.saved_state.state_file import state_directory
from sim_core.files.places import folder_problem, home_problem, temporary_parent
from tensegrity_lab.stack.simulation_lag import busy_text
from tensegrity_robot.ros.discovery import PROFILES, RANGE, installed_middlewares, network_problem

FREE_NEEDED_BYTES = 1_000_000_000
"""An hour's session is some 300 MB, and it is written twice while it is finished."""
TEMPORARY_NEEDED_BYTES = 10_000_000
PYTHONS = ("3.11", "3.12", "3.13")
PACKAGES = ("rclpy", "numpy", "numba", "mcap", "pyserial", "typer", "rich", "PyYAML")


class Health(StrEnum):
    """Of one thing that was looked at."""

    FINE = "fine"
    MEND = "mend"
    SKIPPED = "skipped"


class Finding(NamedTuple):
    """One check's answer: what was looked at, how it is, what was seen, and how to mend it (empty if there is nothing to)."""

    what: str
    health: Health
    told: str
    mend: str = ""


def examine(port: str, board: Board, baud: int, calibration: Path | None, imu: str = "") -> Iterator[Finding]:
    """Every check, in the order in which things must be mended.

    Args:
        port: device or socket://HOST:PORT of the board; empty: the virtual prototype's link.
        board: its kind.
        baud: rate of the port.
        calibration: its file; None: none is given.
        imu: port of an inertial sensor; empty: none is given.
    """
    from tensegrity_lab.commissioning.port_checks import check_bluetooth, check_port, check_sensor

    chosen = port or str(default_link())
    handshake, doubt = virtual_port.examine(chosen)
    virtual = handshake is not None
    yield from check_versions()
    yield check_workspace()
    yield from check_bluetooth(chosen)
    if doubt:
        yield Finding(
            "prototype", Health.MEND, f"{chosen} is not taken for a virtual prototype: {doubt}", "start it anew, or give --port"
        )
    if port or virtual:
        yield from check_port(chosen, baud or board.quirks.usual_baud, board)
    else:
        yield Finding("port", Health.SKIPPED, "none given, and no virtual prototype runs", "give --port, or start a prototype")
    if imu:
        yield from check_sensor(imu)
    yield check_calibration(calibration, real=bool(port) and not virtual)
    yield check_computer()
    yield check_home()
    yield check_folder("temporary", Path(temporary_parent()), TEMPORARY_NEEDED_BYTES, "TMPDIR")
    yield check_folder("bags", bag_folder(""), FREE_NEEDED_BYTES, "SIXSTRUT_BAGS")
    yield check_folder("state", state_directory(), 1_000_000, "SIXSTRUT_STATE_DIR")
    yield check_network()


def check_versions() -> Iterator[Finding]:
    """Python and the packages."""
    version = ".".join(platform.python_version_tuple()[:2])
    if version in PYTHONS:
        yield Finding("python", Health.FINE, platform.python_version())
    else:
        yield Finding("python", Health.MEND, version, f"use one of {', '.join(PYTHONS)}: SIXSTRUT_PYTHON=… ./sixstrut setup")
    missing, found = [], []
    for name in PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            if importlib.util.find_spec(name) is None:
                missing.append(name)
    if missing:
        yield Finding("packages", Health.MEND, f"missing: {', '.join(missing)}", "run: ./sixstrut setup")
    else:
        yield Finding("packages", Health.FINE, ", ".join(found))


def check_workspace() -> Finding:
    """The built packages."""
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix

    try:
        prefixes = {name: get_package_prefix(name) for name in ("tensegrity_interfaces", "tensegrity_robot")}
    except PackageNotFoundError as error:
        return Finding("workspace", Health.MEND, f"not built: {error.args[0]}", "run: ./sixstrut setup")
    return Finding("workspace", Health.FINE, f"built at {prefixes['tensegrity_robot']}")


def check_calibration(path: Path | None, real: bool) -> Finding:
    """The calibration, if a real robot needs one."""
    what = "calibration"
    if path is None:
        if real:
            mend = "measure the robot's own: ./sixstrut calibrate mine.yaml --port PORT; give it with --calibration"
            return Finding(what, Health.MEND, "none given; a real robot is not armed with the virtual prototype's", mend)
        return Finding(what, Health.SKIPPED, "none given; the virtual prototype's is used")
    again = f"./sixstrut calibrate {path} --port PORT"
    try:
        calibration = load_calibration(path)
        unfinished = Unfinished(path)
    except BridgeError as error:
        return Finding(what, Health.MEND, str(error), f"correct that line, or measure anew: {again}")
    if unfinished.path.exists():
        return Finding(what, Health.MEND, f"a newer one is unfinished: {unfinished.path}", f"go on with it: {again}; or remove it")
    told = f"{path}, hash {calibration.hash[:12]}"
    if calibration.robot is not None:
        return Finding(what, Health.FINE, f"robot {calibration.robot!r}, {told}")
    told += ", names no robot"
    if not real:
        return Finding(what, Health.FINE, told)
    mend = f'give the robot a name of its own: add a line such as robot: "blue one" to {path}'
    return Finding(what, Health.MEND, f"{told}: where its struts are and how long they ran is forgotten at each start", mend)


def check_computer() -> Finding:
    """What is there to compute with, and to show it."""
    processors = len(os.sched_getaffinity(0))
    encoding = str(getattr(sys.stdout, "encoding", None) or "utf-8")
    told = f"{processors} processor{'s' if processors > 1 else ''}"
    if not encoding.lower().startswith("utf"):
        told += f"; the terminal's encoding is {encoding}: letters that it lacks become others, or ? (export LC_ALL=C.UTF-8)"
    if busy := busy_text():  # now; it may pass
        return Finding("computer", Health.FINE, f"{told}; {busy}", "end what else runs, or use --real-time or a low --time-scale")
    return Finding("computer", Health.FINE, told)


def check_home() -> Finding:
    """Whether caches, logs and state can be kept from one start to the next."""
    for below in (".cache/sixstrut", ".ros/log", ".local/state/sixstrut"):
        if problem := home_problem(below):
            mend = "export HOME=FOLDER, one of yours; or make it yours again: sudo chown -R $USER FOLDER"
            return Finding("home", Health.MEND, f"{problem}: a temporary folder is used", mend)
    return Finding("home", Health.FINE, str(Path.home()))


def check_folder(what: str, folder: Path, needed_bytes: int, variable: str) -> Finding:
    """Whether a folder, or the one that it will be made in, can be written and has room."""
    if problem := folder_problem(folder, needed_bytes, locks=True):
        return Finding(what, Health.MEND, problem, f"make it writable, make room, or choose another folder with {variable}")
    there = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(there).free
    journals = journals_in(folder)
    left = f"; {len(journals)} unfinished bags, which the next bridge mends" if journals else ""
    return Finding(what, Health.FINE, f"{folder}, {free / 1e9:.1f} GB free{left}")


def check_network() -> Finding:
    """Whether nodes find each other, and who may find the robot. A wider network is a choice, so it is told and not mended."""
    problem, mend = network_problem(os.environ, installed_middlewares())
    if problem:
        return Finding("network", Health.MEND, problem, mend)
    if server := os.environ.get("ROS_DISCOVERY_SERVER"):
        told = f"ROS_DISCOVERY_SERVER={server}: no node finds another unless that server runs"
        return Finding("network", Health.FINE, told, "start it first, or unset ROS_DISCOVERY_SERVER")
    asked = os.environ.get(RANGE, "LOCALHOST")
    if asked != "LOCALHOST" or os.environ.get("ROS_STATIC_PEERS"):
        return Finding("network", Health.FINE, f"by your choice other machines may find and command the robot ({RANGE}={asked})")
    own = os.environ.get(PROFILES)
    return Finding("network", Health.FINE, f"this machine, by {own}" if own else "this machine only, on loopback")
