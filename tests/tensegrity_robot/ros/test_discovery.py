# SPDX-License-Identifier: Apache-2.0
"""Who may find the robot: loopback by default, wider networks only by choice."""

import ipaddress
import os
from pathlib import Path

import pytest

from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros.discovery import (
    PROFILES,
    RANGE,
    TRANSPORTS,
    discovery_changes,
    installed_middlewares,
    network_problem,
    set_discovery,
)  # fmt: skip

PROFILE = Path(__file__)  # any file that exists


def test_this_machine_only_is_the_default_and_what_localhost_means():
    for environ in ({}, {RANGE: "LOCALHOST"}, {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}):
        changes = discovery_changes(environ, PROFILE)
        assert changes == {TRANSPORTS: "UDPv4", PROFILES: str(PROFILE), RANGE: "SYSTEM_DEFAULT"}


@pytest.mark.parametrize(
    "choice", [{RANGE: "SUBNET"}, {RANGE: "OFF"}, {RANGE: "SYSTEM_DEFAULT"}, {"ROS_STATIC_PEERS": "192.0.2.7"}]
)
def test_a_choice_of_the_user_stays(choice):
    assert discovery_changes(choice, PROFILE) == {TRANSPORTS: "UDPv4"}


@pytest.mark.parametrize("own", [{PROFILES: "/home/me/dds.xml"}, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}])
def test_another_profile_or_middleware_is_kept_to_localhost_by_ros_itself(own):
    assert discovery_changes({**own, TRANSPORTS: "DEFAULT"}, PROFILE) == {RANGE: "LOCALHOST"}


def addresses(pid: int) -> set[str]:
    """Local addresses of a process's network sockets."""
    descriptors = Path(f"/proc/{pid}/fd")
    inodes = set()
    for descriptor in descriptors.iterdir():
        try:
            name = os.readlink(descriptor)
        except OSError:
            continue
        if name.startswith("socket:["):
            inodes.add(name[8:-1])
    found = set()
    for protocol in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                words = bytes.fromhex(fields[1].split(":")[0])
                packed = b"".join(words[at : at + 4][::-1] for at in range(0, len(words), 4))
                found.add(str(ipaddress.ip_address(packed)))
    return found


@pytest.mark.slow
@pytest.mark.ros
def test_no_node_has_a_socket_on_any_other_interface(processes, operator):
    processes.node("virtual_prototype", "--time-scale", "10").says("ready")
    nodes = [processes.node(name) for name in ("hardware_bridge", "twin", "gait_planner")]
    operator.wait_for_stack()
    for node in nodes:
        assert addresses(node.pid) == {"127.0.0.1"}, node.name


@pytest.mark.ros
def test_a_wider_network_is_a_choice(processes):
    node = processes.node("hardware_bridge", environ={RANGE: "SUBNET"})
    node.says("virtual_prototype")
    wait_until(lambda: "0.0.0.0" in addresses(node.pid), 10.0, "sockets on every interface")


def test_the_profile_is_installed(monkeypatch):
    for name in (PROFILES, RANGE, TRANSPORTS, "ROS_STATIC_PEERS"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    set_discovery()
    assert Path(os.environ[PROFILES]).exists()


@pytest.mark.parametrize(
    ("environ", "problem", "mend"),
    [
        ({"ROS_DOMAIN_ID": "lab"}, "ROS_DOMAIN_ID=lab", "valid is 0 to 232"),
        ({"ROS_DOMAIN_ID": "-1"}, "ROS_DOMAIN_ID=-1", "valid is 0 to 232"),
        ({"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID=233", "unset it"),
        ({RANGE: "OFF"}, f"{RANGE}=OFF: no node finds another", f"unset {RANGE}"),
        ({RANGE: "localhost"}, f"{RANGE}=localhost", "valid are LOCALHOST, SUBNET"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "rmw_cyclonedds_cpp is not installed", "installed are: rmw_fastrtps_cpp"),
        ({PROFILES: "/nowhere.xml"}, f"{PROFILES}=/nowhere.xml: there is no such file", f"unset {PROFILES}"),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "/nowhere.xml"}, "FASTDDS_DEFAULT_PROFILES_FILE=/nowhere.xml", "unset"),
        ({"ROS_STATIC_PEERS": "127.0.0.1;256.1.1.1:x"}, "ROS_STATIC_PEERS: 256.1.1.1:x is not known", "addresses with ;"),
    ],
)
def test_a_network_in_which_nothing_works_is_told_by_its_variable(environ, problem, mend):
    told, how = network_problem(environ, ["rmw_fastrtps_cpp"])
    assert problem in told
    assert mend in how


@pytest.mark.parametrize("environ", [{}, {"ROS_DOMAIN_ID": " 7 "}, {RANGE: "SUBNET"}, {"ROS_STATIC_PEERS": "127.0.0.1"}])
def test_a_network_that_works_is_no_problem(environ):
    assert network_problem(environ, ["rmw_fastrtps_cpp"]) == ("", "")


def test_the_installed_middleware_is_known():
    assert "rmw_fastrtps_cpp" in installed_middlewares()


@pytest.mark.ros
@pytest.mark.parametrize("name", ["hardware_bridge", "gait_planner"])
@pytest.mark.parametrize(
    "environ", [{RANGE: "OFF"}, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, {PROFILES: "/nowhere.xml"}], ids=lambda one: str(one)
)
def test_a_node_that_could_find_nobody_ends_with_a_line_that_names_the_variable(name, environ, processes):
    node = processes.node(name, environ=environ)
    assert node.ends() != 0
    assert f"{next(iter(environ))}={next(iter(environ.values()))}" in node.output


@pytest.mark.ros
def test_a_node_without_a_home_keeps_its_logs_in_a_temporary_folder(processes, tmp_path):
    node = processes.node("twin", environ={"HOME": "relative", "ROS_LOG_DIR": "", "ROS_HOME": ""})
    node.says("caches, logs and state are kept in")


@pytest.mark.ros
def test_ros_that_does_not_start_for_another_reason_names_what_is_set(processes):
    node = processes.node("gait_planner", environ={"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"})
    assert node.ends() == 1
    assert "error: ROS does not start: " in node.output
    assert "ROS_SECURITY_ENABLE, ROS_SECURITY_STRATEGY" in node.output
