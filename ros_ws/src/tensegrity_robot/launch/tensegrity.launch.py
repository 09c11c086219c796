# SPDX-License-Identifier: Apache-2.0
"""The whole stack: bridge, planner, traveller, twin; with `virtual:=true` (the default) also a virtual prototype to drive.

    ros2 launch tensegrity_robot tensegrity.launch.py
    ros2 launch tensegrity_robot tensegrity.launch.py virtual:=false port:=/dev/rfcomm0 calibration:=/path/to/mine.yaml
    ros2 launch tensegrity_robot tensegrity.launch.py imu:=wt901                 # its faces told by an inertial sensor in its box
    ros2 launch tensegrity_robot tensegrity.launch.py namespace:=blue            # beside another one

Nothing moves until somebody arms: ros2 service call /arm tensegrity_interfaces/srv/Arm "{lifted_and_clear: true}", in a namespace
/blue/arm. Arguments that were given go before `params_file`, and that before the nodes' own files.

If any of these processes ends, all end, and none outlives the launch, however that ends: a bridge without its stack would go on
holding the port.
"""

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hardware_bridge.driver.child_process import bound
from hardware_bridge.prototype_client.handshake import default_link
from tensegrity_robot.ros.launch_arguments import ARGUMENTS, WT901, require_arguments, truth

PACKAGE = "tensegrity_robot"
LAUNCHS_OWN = ("launch-prefix", "launch-prefix-filter")
KINDS = {"time_scale": float, "rested_s": float, "silent_board": bool}
DEFAULTS = {name: value for name, value, _ in ARGUMENTS}


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, SetEnvironmentVariable("PYTHONUNBUFFERED", "1"), OpaqueFunction(function=_processes)])


def _processes(context: LaunchContext) -> list[Action]:
    """The nodes; refuses every argument that cannot be before any of them starts."""
    share = Path(get_package_share_directory(PACKAGE))
    given = {name: LaunchConfiguration(name).perform(context) for name in DEFAULTS}
    words = {}
    if any(Path(word).name == Path(__file__).name for word in sys.argv):  # not included by another file, which has its own
        words = {name: "" for name, is_one, _ in (word.partition(":=") for word in context.argv) if is_one}
    others = {name: value for name, value in words.items() if name not in LAUNCHS_OWN}
    require_arguments(others | given, get_package_prefix, share / "config")
    own = given["namespace"].strip("/")
    outer = context.launch_configurations.get("ros_namespace", "").strip("/")  # of a launch file that includes this one
    space = "/".join(filter(None, (outer, own)))
    files = [given["params_file"]] if given["params_file"] else []
    prefix = [shlex.join(bound()), " ", LaunchConfiguration("launch-prefix", default="")]

    def node(name: str, *arguments: str, fixed: Mapping[str, str] = MappingProxyType({}), **renamed: str) -> Node:
        """With these parameters from the arguments that were given: a default must not hide what `params_file` says."""
        chosen: dict[str, Any] = {
            parameter: ParameterValue(LaunchConfiguration(argument), value_type=KINDS.get(argument, str))
            for parameter, argument in {**dict(zip(arguments, arguments, strict=True)), **renamed}.items()
            if given[argument] != DEFAULTS[argument]
        }
        chosen |= fixed
        return Node(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=own,
            exec_name=name,  # what launch calls the process, which begins as Python
            parameters=[str(share / "config" / f"{name}.yaml"), *files, *([chosen] if chosen else [])],
            output="both",
            emulate_tty=False,
            prefix=prefix,
            on_exit=Shutdown(reason=f"{name} has ended"),
            sigterm_timeout="15",  # the bridge verifies its bag when it ends
        )

    virtual = truth(given, "virtual")
    processes: list[Action] = [
        node("twin", "start_face", "mounting"),
        node("gait_planner", "library"),
        node("traveller", "library"),
        node(
            "hardware_bridge",
            *("port", "board", "time_scale", "calibration", "rested_s", "silent_board", "library"),
            bag_folder="bags",
            fixed={"observer": "none"} if virtual and given["imu"] else {},
        ),
    ]
    if given["imu"]:
        processes.append(node("face_estimator", "mounting"))
    if given["imu"] == WT901:
        processes.append(node("imu_driver", port="imu_port"))
    if truth(given, "rviz"):
        view = ["-d", str(share / "rviz" / "tensegrity.rviz"), "-f", f"{space}/odom".lstrip("/")]  # its topics are relative
        processes.append(Node(package="rviz2", executable="rviz2", namespace=own, arguments=view, prefix=prefix))
    if virtual:
        drawn = ("seed", "perturbation", "incline", "time_scale", "board")
        options = [option for name in drawn for option in (f"--{name.replace('_', '-')}", given[name])]
        options += ["--imu", WT901] if given["imu"] == WT901 else []
        # Not a ROS node: it would not understand the --ros-args that launch gives to every node.
        name = "virtual_prototype"
        program = str(Path(get_package_prefix(PACKAGE)) / "lib" / PACKAGE / name)
        command = [program, "--link", str(default_link(space)), "--face", given["start_face"], *options]
        ended = Shutdown(reason=f"{name} has ended")
        processes.insert(0, ExecuteProcess(cmd=command, name=name, output="both", prefix=prefix, on_exit=ended))
    return processes
