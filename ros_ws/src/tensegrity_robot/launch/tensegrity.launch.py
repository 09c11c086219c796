"""The whole stack: bridge, planner, traveller, twin; with `virtual:=true` (the default) also a virtual prototype to drive.

    ros2 launch tensegrity_robot tensegrity.launch.py
    ros2 launch tensegrity_robot tensegrity.launch.py virtual:=false port:=/dev/rfcomm0 calibration:=/path/to/mine.yaml

Nothing moves until somebody arms: ros2 service call /arm tensegrity_interfaces/srv/Arm "{lifted_and_clear: true}"
"""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackagePrefix, FindPackageShare

PACKAGE = "tensegrity_robot"

ARGUMENTS = (
    ("virtual", "true", "start a virtual prototype and drive it; false: drive the board at `port`"),
    ("port", "", "device or pyserial URL of the board; empty: the virtual prototype's link"),
    ("board", "lsc", "servo board: lsc, ssc32, maestro, maestro:crc, maestro:device=12:crc"),
    ("perturbation", "0.05", "how far the virtual prototype is off the nominal robot, 0.05 for ±5 %"),
    ("incline", "0.0", "incline of the virtual prototype's ground in degrees, downhill in a direction that the seed draws"),
    ("seed", "0", "draws the virtual prototype's true parameters"),
    ("time_scale", "1.0", "robot seconds per second; other than 1 only with a virtual prototype"),
    ("start_face", "TC6", "face on which robot and twin start"),
    ("calibration", "", "calibration YAML; empty: the virtual prototype's"),
    ("library", "robust", "gait library: a shipped name, or a YAML file"),
    ("bags", "", "folder for the recorded bags; empty: $SIXSTRUT_BAGS or ./bags"),
    ("rviz", "false", "start RViz with the twin"),
)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, SetEnvironmentVariable("PYTHONUNBUFFERED", "1"), OpaqueFunction(function=_processes)])


def _processes(context: LaunchContext) -> list[Action]:
    """The nodes; refuses arguments that contradict each other."""
    virtual = IfCondition(LaunchConfiguration("virtual")).evaluate(context)
    port = LaunchConfiguration("port").perform(context)
    if virtual and port:
        raise RuntimeError(f"port:={port} is a real robot's: give virtual:=false with it")
    if not virtual and not port:
        raise RuntimeError("virtual:=false needs the board's port, such as port:=/dev/rfcomm0")
    config = Path(get_package_share_directory(PACKAGE)) / "config"

    def text(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=str)

    def number(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=float)

    def node(name: str, **parameters: ParameterValue) -> Node:
        return Node(
            package=PACKAGE,
            executable=name,
            name=name,
            parameters=[str(config / f"{name}.yaml"), parameters],
            output="both",
            emulate_tty=False,
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
            library=text("library"),
            bag_folder=text("bags"),
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            arguments=["-d", PathJoinSubstitution([FindPackageShare(PACKAGE), "rviz", "tensegrity.rviz"])],
            condition=IfCondition(LaunchConfiguration("rviz")),
        ),
    ]
    if virtual:
        arguments: list[str | LaunchConfiguration] = []
        for option, name in (
            ("seed", "seed"),
            ("perturbation", "perturbation"),
            ("incline", "incline"),
            ("time-scale", "time_scale"),
            ("face", "start_face"),
            ("board", "board"),
        ):
            arguments += [f"--{option}", LaunchConfiguration(name)]
        # Not a ROS node: it would not understand the --ros-args that launch gives to every node.
        program = PathJoinSubstitution([FindPackagePrefix(PACKAGE), "lib", PACKAGE, "virtual_prototype"])
        processes.insert(0, ExecuteProcess(cmd=[program, *arguments], name="virtual_prototype", output="both"))
    return processes
