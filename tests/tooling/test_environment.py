# SPDX-License-Identifier: Apache-2.0
import subprocess
from pathlib import Path

import pytest

from tooling import environment
from tooling.layout import Layout

LAYOUT = Layout(Path("/robot"))
WORKSPACE = {
    "AMENT_PREFIX_PATH": ["/robot/ros_ws/install/tensegrity_interfaces"],
    "PYTHONPATH": ["/robot/ros_ws/build/sim_core"],
    "LD_LIBRARY_PATH": ["/robot/ros_ws/install/tensegrity_interfaces/lib"],
}
APT_ROS = {
    "AMENT_PREFIX_PATH": "/opt/ros/humble",
    "PATH": "/opt/ros/humble/bin:/usr/bin",
    "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages:/home/me/lib",
    "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/ros/humble-extra/lib",
    "CMAKE_PREFIX_PATH": "/opt/ros/humble",
    "ROS_DISTRO": "humble",
    "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_DOMAIN_ID": "7",
}


def overlaid(environ: dict[str, str]) -> dict[str, str]:
    return environment.applied(environ, environment.overlay(environ, LAYOUT, WORKSPACE))


def test_the_workspace_comes_before_the_wheels():
    environ = overlaid({"PATH": "/usr/bin"})
    assert environ["AMENT_PREFIX_PATH"] == "/robot/ros_ws/install/tensegrity_interfaces:/robot/.venv"
    assert environ["PATH"] == "/robot/.venv/bin:/usr/bin"
    assert environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_a_sourced_ros_is_taken_out_and_the_users_own_entries_stay():
    environ = overlaid(APT_ROS)
    assert not [name for name, value in environ.items() if "/opt/ros/humble/" in value + "/"]
    assert environ["PYTHONPATH"] == "/robot/ros_ws/build/sim_core:/home/me/lib"
    assert environ["LD_LIBRARY_PATH"].endswith(":/opt/ros/humble-extra/lib")
    assert environ["ROS_DISTRO"] == "jazzy"
    assert environ["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert "CMAKE_PREFIX_PATH" not in environ


def test_the_users_domain_is_respected():
    assert overlaid(APT_ROS)["ROS_DOMAIN_ID"] == "7"
    assert "ROS_DOMAIN_ID" not in overlaid({})


def test_a_wider_discovery_range_needs_the_users_own_word():
    assert overlaid(APT_ROS)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert overlaid({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"})["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    own_shell = {**overlaid({}), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    assert overlaid(own_shell)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"


def test_setting_it_twice_is_the_same_as_once():
    once = overlaid({"PATH": "/usr/bin", "LD_LIBRARY_PATH": "/home/me/lib"})
    assert overlaid(once) == once


def test_another_checkouts_environment_leaves_no_trace():
    other = environment.overlay({"PATH": "/usr/bin"}, Layout(Path("/old")), {"PYTHONPATH": ["/old/ros_ws/build/sim_core"]})
    environ = overlaid(environment.applied({"PATH": "/usr/bin"}, other))
    assert not [name for name, value in environ.items() if "/old" in value]


def test_the_wheels_start_hook_is_never_passed_on_to_a_shell():
    environ = overlaid({"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"})
    assert "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in environ


def test_no_search_path_gets_an_empty_entry():
    environ = overlaid({"PATH": "/usr/bin:", "LD_LIBRARY_PATH": ":"})
    assert "" not in [entry for name, value in environ.items() if "PATH" in name for entry in value.split(":")]


@pytest.mark.parametrize("value", ["plain", "with space", "quote's $HOME `x`"])
def test_a_shell_reads_back_what_is_exported(value: str):
    lines = environment.exports({"ROBOT_VALUE": value, "ROBOT_GONE": None})
    script = 'ROBOT_GONE=1; eval "$1"; printf %s "$ROBOT_VALUE${ROBOT_GONE-}"'
    output = subprocess.run(["sh", "-c", script, "sh", lines], capture_output=True, text=True, check=True).stdout
    assert output == value
