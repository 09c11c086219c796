# SPDX-License-Identifier: Apache-2.0
"""The launch file: what cannot be is refused before anything starts, and no process outlives another or the launch.

Where the real `launch` and `launch_ros` are not installed, the file is loaded with stand-ins that only keep what they are given.
"""

import importlib.util
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, ModuleType, SimpleNamespace
from typing import Any

import psutil
import pytest

from hardware_bridge.driver.child_process import bound
from tensegrity_robot.ros.errors import StartError
from tensegrity_robot.ros.launch_arguments import ARGUMENTS, require_arguments

FILE = Path(__file__).parents[3] / "ros_ws" / "src" / "tensegrity_robot" / "launch" / "tensegrity.launch.py"
CONFIG = FILE.parents[1] / "config"
DEFAULTS = {name: value for name, value, _ in ARGUMENTS}
VITAL = {"virtual_prototype", "hardware_bridge", "gait_planner", "traveller", "twin"}
REAL = importlib.util.find_spec("launch_ros") is not None
WRONG = [
    ({"virtual": "maybe"}, "virtual:=maybe: valid is true or false"),
    ({"port": "/dev/null"}, "port:=/dev/null is a real robot's: give virtual:=false with it"),
    ({"virtual": "false"}, "virtual:=false needs the board's port"),
    ({"virtual": "false", "port": "/dev/rfcomm77"}, "port:=/dev/rfcomm77 does not exist"),
    ({"virtual": "false", "port": "/dev/null", "time_scale": "2"}, "time_scale:=2: a real robot's is 1"),
    ({"time_scale": "nan"}, "time_scale:=nan: valid is a number from 0.01 to 100"),
    ({"perturbation": "0.31"}, "perturbation:=0.31: valid is a number from 0 to 0.3"),
    ({"incline": "steep"}, "incline:=steep: valid is a number from 0 to 20"),
    ({"seed": "-1"}, "seed:=-1: valid is a whole number"),
    ({"seed": "1.5"}, "seed:=1.5: valid is a whole number"),
    ({"start_face": "TC9"}, "unknown face 'TC9'"),
    ({"board": "arduino"}, "board is 'arduino', valid is lsc"),
    ({"library": "nonesuch"}, "shipped are:"),
    ({"calibration": "/nowhere.yaml"}, "calibration /nowhere.yaml: cannot be read"),
    ({"bags": "/proc/bags"}, "bags:=/proc/bags cannot be written"),
    ({"imu": "mpu6050"}, "imu:=mpu6050: valid are wt901, topic, or nothing"),
    ({"mounting": "mine.yaml"}, "imu_port and mounting are of an inertial sensor: give imu:=wt901"),
    ({"imu": "wt901", "imu_port": "/dev/null"}, "the virtual prototype has its own"),
    (
        {"virtual": "false", "port": "/dev/null", "imu": "wt901", "imu_port": "/dev/null"},
        "imu_port:=/dev/null is the board's port: give each its own",
    ),
    ({"virtual": "false", "port": "/dev/null", "imu": "wt901"}, "imu:=wt901 needs the sensor's port"),
    ({"imu": "topic", "mounting": "/nowhere.yaml"}, "cannot read mounting /nowhere.yaml"),
    ({"rviz": "yes"}, "rviz:=yes: valid is true or false"),
    ({"rviz": "true"}, "rviz:=true, but rviz2 is not installed"),
    ({"namespace": "my robot"}, "namespace:=my robot: valid are letters, digits and single _"),
    ({"namespace": "blue__2"}, "such as blue or lab/blue"),
    ({"namespace": "b" * 41}, "at most 40 in all"),
    ({"params_file": "/nowhere.yaml"}, "params_file:=/nowhere.yaml cannot be read: No such file or directory"),
    ({"perturbaton": "0.1"}, "unknown argument perturbaton: did you mean perturbation? Valid are namespace, params_file, virtual"),
    ({"timescale": "2"}, "unknown argument timescale: did you mean time_scale?"),
    ({"face": "TC6"}, "unknown argument face: did you mean start_face?"),
]
PARAMETERS = [
    (
        "/**/hardware_bridge: {ros__parameters: {space_limit: 1.0}}",
        "of hardware_bridge space_limit: did you mean space_limit_mb?",
    ),
    ("blue: {twin: {ros__parameters: {rate: 5.0}}}", "unknown parameter of twin rate: did you mean rate_hz?"),
    ("/blue/twn: {ros__parameters: {rate_hz: 5.0}}", "unknown node twn: did you mean twin? Valid in"),
    ("/**: {ros__parameters: {library: robust}}", "library: did you mean"),
    ("twin: 3", "is no parameter file: valid is NODE: {ros__parameters: {NAME: VALUE}}"),
    ("twin: {ros__parameters: {rate_hz: 5.0, rate_hz: 6.0}}", "rate_hz"),
    ("[1, 2", "is not valid YAML"),
]


def nowhere(package: str) -> str:
    raise KeyError(package)


@pytest.mark.parametrize(("given", "why"), WRONG, ids=[" ".join(f"{k}:={v}" for k, v in given.items()) for given, _ in WRONG])
def test_what_cannot_be_is_refused(tmp_path: Path, given: dict[str, str], why: str) -> None:
    with pytest.raises(StartError) as refused:
        require_arguments(DEFAULTS | {"bags": str(tmp_path)} | given, nowhere, CONFIG)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_can_be_is_not(tmp_path: Path) -> None:
    require_arguments(DEFAULTS | {"bags": str(tmp_path / "new"), "namespace": "/lab/blue_2/"}, nowhere, CONFIG)
    assert (tmp_path / "new").is_dir()
    rviz = tmp_path / "lib" / "rviz2" / "rviz2"
    rviz.parent.mkdir(parents=True)
    rviz.touch(mode=0o755)
    require_arguments(DEFAULTS | {"bags": str(tmp_path), "rviz": "True", "virtual": "1"}, lambda package: str(tmp_path), CONFIG)
    for own in CONFIG.glob("*.yaml"):
        require_arguments(DEFAULTS | {"bags": str(tmp_path), "params_file": str(own)}, nowhere, CONFIG)


@pytest.mark.parametrize(("text", "why"), PARAMETERS)
def test_a_parameter_file_names_nodes_and_parameters_that_there_are(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(StartError) as refused:
        require_arguments(DEFAULTS | {"bags": str(tmp_path), "params_file": str(file)}, nowhere, CONFIG)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)


# ---- the file ---------------------------------------------------------------------------------------------------------------


class Kept(SimpleNamespace):
    """Something of launch's that keeps what it is given."""

    def __init__(self, *args: Any, **words: Any) -> None:
        super().__init__(args=args, **words)


class Configuration(Kept):
    """A launch argument."""

    def perform(self, context: Any) -> str:
        return str(context.given[self.args[0]])


@pytest.fixture
def processes_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The launch file's actions for arguments, with stand-ins for launch."""
    names = {
        "launch": ("Action", "LaunchContext", "LaunchDescription"),
        "launch.actions": ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction", "SetEnvironmentVariable", "Shutdown"),
        "launch.substitutions": (),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
    }
    for module, kinds in names.items():
        stand_in = ModuleType(module)
        for kind in kinds:
            setattr(stand_in, kind, type(kind, (Kept,), {}))
        monkeypatch.setitem(sys.modules, module, stand_in)
    sys.modules["launch.substitutions"].LaunchConfiguration = Configuration  # type: ignore[attr-defined]
    spec = importlib.util.spec_from_file_location("tensegrity_launch", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (function,) = [action.function for action in module.generate_launch_description().args[0] if hasattr(action, "function")]

    def processes(*argv: str, pushed: Mapping[str, str] = MappingProxyType({}), **given: str) -> list[Any]:
        monkeypatch.setattr(sys, "argv", ["ros2", "launch", "tensegrity_robot", FILE.name, *argv])
        made: list[Any] = function(SimpleNamespace(given=DEFAULTS | given, argv=list(argv), launch_configurations=pushed))
        return made

    return processes


def test_whoever_ends_ends_all_and_nobody_outlives_the_launch(processes_of: Any, tmp_path: Path) -> None:
    made = processes_of(bags=str(tmp_path))
    assert {action.name for action in made} == VITAL
    for action in made:
        assert type(action.on_exit).__name__ == "Shutdown"
        assert action.on_exit.reason == f"{action.name} has ended"
        assert shlex.split(action.prefix[0]) == bound(), "the kernel interrupts it when the launch dies"


def test_nothing_is_made_of_wrong_arguments(processes_of: Any, tmp_path: Path) -> None:
    with pytest.raises(StartError, match="board is 'arduino'"):
        processes_of(board="arduino", bags=str(tmp_path))
    with pytest.raises(StartError, match="did you mean perturbation"):
        processes_of("perturbaton:=0.1", bags=str(tmp_path))


def test_all_of_it_is_in_the_namespace_and_so_is_its_prototype(processes_of: Any, tmp_path: Path) -> None:
    for given, outer, link in (
        ("/blue/", "", "prototype-blue"),
        ("", "lab", "prototype-lab"),
        ("blue", "/lab", "prototype-lab-blue"),
    ):
        prototype, *nodes = processes_of(bags=str(tmp_path), namespace=given, pushed={"ros_namespace": outer})
        assert Path(prototype.cmd[prototype.cmd.index("--link") + 1]).name == link
        assert {node.namespace for node in nodes} == {given.strip("/")}


def test_an_inertial_sensor_brings_its_nodes_and_is_alone_in_telling_faces(processes_of: Any, tmp_path: Path) -> None:
    mounting = tmp_path / "mounting.yaml"
    mounting.write_text("quaternion: [1.0, 0.0, 0.0, 0.0]\n", encoding="utf-8")
    made = {action.name: action for action in processes_of(bags=str(tmp_path), imu="wt901", mounting=str(mounting))}
    assert set(made) == VITAL | {"imu_driver", "face_estimator"}
    prototype = made["virtual_prototype"].cmd
    assert prototype[prototype.index("--imu") + 1] == "wt901"
    assert made["hardware_bridge"].parameters[-1]["observer"] == "none"
    assert {"mounting"} == set(made["face_estimator"].parameters[-1]) == set(made["twin"].parameters[-1])
    real = {"virtual": "false", "port": "/dev/null", "imu": "topic"}
    made = {action.name: action for action in processes_of(bags=str(tmp_path), **real)}
    assert set(made) == VITAL - {"virtual_prototype"} | {"face_estimator"}, "somebody else's driver"
    assert "observer" not in made["hardware_bridge"].parameters[-1], "a camera may look, too"


def test_what_is_given_goes_before_the_parameter_file_and_what_is_not_does_not(processes_of: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("hardware_bridge: {ros__parameters: {library: paper, stall_limit_m: 0.01}}", encoding="utf-8")
    made = processes_of(bags=str(tmp_path), params_file=str(file), time_scale="4")
    (bridge,) = [action for action in made if action.name == "hardware_bridge"]
    own, mine, given = bridge.parameters
    assert (Path(own).name, mine, set(given)) == ("hardware_bridge.yaml", str(file), {"time_scale", "bag_folder"})
    (twin,) = [action for action in made if action.name == "twin"]
    assert len(twin.parameters) == 2, "its face is the default, which a file may change"


# ---- the real launch --------------------------------------------------------------------------------------------------------

AS_ROS2_LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
path, words = sys.argv[1], sys.argv[2:]
service = LaunchService(argv=words, noninteractive=True)
given = [tuple(word.split(":=", 1)) for word in words]
included = IncludeLaunchDescription(PythonLaunchDescriptionSource(path), launch_arguments=given)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""
needs_launch = pytest.mark.skipif(not REAL, reason="launch and launch_ros are not installed: they come with an installed ROS")


@pytest.fixture
def launched(tmp_path: Path, domain: int, compiled: None) -> Iterator[Any]:
    """Starts the launch as `ros2 launch` does: (process, its output)."""
    started: list[subprocess.Popen[bytes]] = []
    log = tmp_path / "launch.log"
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    environ = {"ROS_DOMAIN_ID": str(domain), "SIXSTRUT_STATE_DIR": str(state), "ROS_LOG_DIR": str(tmp_path / "log")}

    def start(*words: str) -> tuple[subprocess.Popen[bytes], Path]:
        command = [sys.executable, "-c", AS_ROS2_LAUNCH, str(FILE), f"bags:={tmp_path / 'bags'}", *words]
        with log.open("wb") as output:
            started.append(subprocess.Popen(command, stdout=output, stderr=output, env={**os.environ, **environ}))
        return started[-1], log

    yield start
    for process in started:
        process.kill()
        process.wait()


@needs_launch
@pytest.mark.ros
@pytest.mark.parametrize("word", ["rviz:=true", "board:=arduino", "perturbaton:=0.1"])
def test_a_bad_argument_starts_nothing(launched: Any, word: str) -> None:
    process, log = launched(word)
    assert process.wait(60.0) == 1
    assert "process started" not in log.read_text()


@needs_launch
@pytest.mark.ros
@pytest.mark.parametrize("victim", ["hardware_bridge", "virtual_prototype", "the launch"])
def test_no_process_is_left(launched: Any, victim: str) -> None:
    process, log = launched("time_scale:=4")
    end = time.monotonic() + 100.0
    while "DISARMED, nothing moves" not in log.read_text():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.05)
    family = psutil.Process(process.pid).children(recursive=True)
    names = {Path(word).name: one for one in family for word in one.cmdline() if "/lib/tensegrity_robot/" in word}
    assert set(names) == VITAL
    if victim in names:
        names[victim].kill()
    else:
        process.send_signal(signal.SIGKILL)
    process.wait(60.0)
    _, alive = psutil.wait_procs(family, 60.0)
    assert not alive
