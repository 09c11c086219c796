# SPDX-License-Identifier: Apache-2.0
"""The whole stack: bridge, planner, traveller, twin; with `virtual:=true` (the default) also a virtual prototype to drive.

    ros2 launch tensegrity_robot tensegrity.launch.py
    ros2 launch tensegrity_robot tensegrity.launch.py virtual:=false port:=/dev/rfcomm0 calibration:=/path/to/mine.yaml

Nothing moves until somebody arms: ros2 service call /arm tensegrity_interfaces/srv/Arm "{lifted_and_clear: true}"

If any of these processes ends, all end, and none outlives the launch, however that ends: a bridge without its stack would go on
holding the port.
"""

import shlex
import sys
from pathlib import Path

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hardware_bridge.driver.child_process import bound
from tensegrity_robot.ros.launch_arguments import ARGUMENTS, require_arguments, require_known, truth

PACKAGE = "tensegrity_robot"
LAUNCHS_OWN = ("launch-prefix", "launch-prefix-filter")


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, SetEnvironmentVariable("PYTHONUNBUFFERED", "1"), OpaqueFunction(function=_processes)])


def _processes(context: LaunchContext) -> list[Action]:
    """The nodes; refuses every argument that cannot be before any of them starts."""
    if any(Path(word).name == Path(__file__).name for word in sys.argv):  # not included by another file, which has its own
        words = (word.partition(":=")[0] for word in context.argv if ":=" in word)
        require_known([word for word in words if word not in LAUNCHS_OWN])
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    require_arguments(given, get_package_prefix)
    share = Path(get_package_share_directory(PACKAGE))
    prefix = [shlex.join(bound()), " ", LaunchConfiguration("launch-prefix", default="")]

    def text(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=str)

    def number(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=float)

    def node(name: str, **parameters: ParameterValue) -> Node:
        return Node(
            package=PACKAGE,
            executable=name,
            name=name,
            exec_name=name,  # what launch calls the process, which begins as Python
            parameters=[str(share / "config" / f"{name}.yaml"), parameters],
            output="both",
            emulate_tty=False,
            prefix=prefix,
            on_exit=Shutdown(reason=f"{name} has ended"),
            sigterm_timeout="15",  # the bridge verifies its bag when it ends
        )

    processes: list[Action] = [
        node("twin", start_face=text("start_face")),
        node("gait_planner", library=text("library")),
        node("traveller", library=text("library")),
        node(
            "hardware_bridge",
            port=text("port"),
            board=text("board"),
            time_scale=number("time_scale"),
            calibration=text("calibration"),
            rested_s=number("rested_s"),
            silent_board=ParameterValue(LaunchConfiguration("silent_board"), value_type=bool),
            library=text("library"),
            bag_folder=text("bags"),
        ),
    ]
    if truth(given, "rviz"):
        view = ["-d", str(share / "rviz" / "tensegrity.rviz")]
        processes.append(Node(package="rviz2", executable="rviz2", arguments=view, prefix=prefix))
    if truth(given, "virtual"):
        drawn = ("seed", "perturbation", "incline", "time_scale", "board")
        options = [option for name in drawn for option in (f"--{name.replace('_', '-')}", given[name])]
        # Not a ROS node: it would not understand the --ros-args that launch gives to every node.
        name = "virtual_prototype"
        program = str(Path(get_package_prefix(PACKAGE)) / "lib" / PACKAGE / name)
        command = [program, "--face", given["start_face"], *options]
        ended = Shutdown(reason=f"{name} has ended")
        processes.insert(0, ExecuteProcess(cmd=command, name=name, output="both", prefix=prefix, on_exit=ended))
    return processes
