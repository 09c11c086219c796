# SPDX-License-Identifier: Apache-2.0
"""What ROS's own tools make of the packages: catkin_pkg, rosdep's keys, colcon test."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
FOLDERS = sorted(path.parent for below in ("src", "without_ros") for path in (ROOT / "ros_ws").glob(f"{below}/*/package.xml"))
PYTHON = [folder for folder in FOLDERS if (folder / "setup.py").exists()]
RULES = yaml.safe_load((ROOT / "ros_ws" / "rosdep" / "sixstrut.yaml").read_text(encoding="utf-8"))
ROSDISTRO = {
    *("mcap-ros2-support", "python3-matplotlib", "python3-numba", "python3-numpy", "python3-pil", "python3-pytest", "python3-rich"),
    *("python3-scipy", "python3-serial", "python3-tornado", "python3-websockets", "python3-yaml"),
}
"""Keys of rosdep/python.yaml for Ubuntu, as it was in August 2026."""
JAZZY = {
    *("action_msgs", "ament_cmake", "ament_index_python", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "launch"),
    *("launch_ros", "lifecycle_msgs", "nav_msgs", "rcl_interfaces", "rclpy", "ros2launch", "rosidl_default_generators"),
    *("rosidl_default_runtime", "sensor_msgs", "std_msgs", "std_srvs", "tf2_msgs", "trajectory_msgs", "visualization_msgs"),
}
"""Packages of jazzy/distribution.yaml."""
KEYS = {"matplotlib", "numba", "numpy", "rich", "scipy", "tornado", "websockets", "yaml"}
KEY_OF = {
    **{name: f"python3-{name}" for name in KEYS},
    **{name: f"python3-{name}-pip" for name in ("msgspec", "typer", "viser")},
    **dict.fromkeys(("mcap", "mcap_ros2", "lz4", "zstandard"), "mcap-ros2-support"),
    "PIL": "python3-pil",
    "llvmlite": "python3-numba",
    "serial": "python3-serial",
}
"""Module -> key, where the two differ."""
NOT_AT_RUN_TIME = {"setuptools", "tests", "docs", "distributed", "_typeshed"}
"""Of set-up, of the repository's own tools, of a Dask cluster, of type checks."""
BY_THE_COMMAND = {"ros2launch", "lifecycle_msgs"}
"""Which users need, and rclpy: no module of ours imports it."""


def parsed(folder):
    from catkin_pkg.package import parse_package

    warnings: list[str] = []
    package = parse_package(str(folder / "package.xml"), warnings=warnings)
    assert not warnings
    return package


def imported(folder):
    for file in sorted((folder / folder.name).rglob("*.py")) + sorted(folder.glob("launch/*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (name.name.partition(".")[0] for name in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module.partition(".")[0]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_package_xml_is_valid_and_says_what_the_project_says_of_itself(folder):
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    package = parsed(folder)
    package.validate()
    assert package.name == folder.name
    assert package.licenses == [citation["license"]]
    (maintainer,) = package.maintainers
    assert [maintainer.name] == [author["name"] for author in citation["authors"]]
    assert maintainer.email.endswith(".invalid"), "there is no address, and none is made up"
    assert package.get_build_type() == ("ament_python" if folder in PYTHON else "ament_cmake")
    if folder.name != "tf2_msgs":  # whose version is upstream's
        assert package.version == str(citation["version"])
        assert "CHANGELOG.md" in (folder / "CHANGELOG.rst").read_text(encoding="utf-8")
    if folder in PYTHON:
        setup = (folder / "setup.py").read_text(encoding="utf-8")
        for said in (package.description, package.version, maintainer.email, maintainer.name):
            assert f'"{said}"' in setup


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_rosdep_knows_every_key(folder):
    own = {other.name for other in FOLDERS}
    package = parsed(folder)
    keys = {d.name for d in (*package.exec_depends, *package.build_depends, *package.buildtool_depends, *package.test_depends)}
    assert keys <= own | JAZZY | ROSDISTRO | RULES.keys()


@pytest.mark.parametrize("folder", PYTHON, ids=lambda folder: folder.name)
def test_what_a_package_imports_it_declares_and_nothing_else(folder):
    modules = {name for name in imported(folder) if name not in sys.stdlib_module_names} - NOT_AT_RUN_TIME - {folder.name}
    declared = {dependency.name for dependency in parsed(folder).exec_depends}
    assert {KEY_OF.get(name, name) for name in modules} == declared - BY_THE_COMMAND


def test_the_rules_name_packages_that_set_up_installs_too():
    wanted = "\n".join(file.read_text(encoding="utf-8") for file in (ROOT / "requirements").glob("*.in"))
    for key, systems in RULES.items():
        (package,) = systems["ubuntu"]["pip"]["packages"]
        assert key == f"python3-{package}-pip"
        assert re.search(rf"^{package}\b", wanted, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_colcon_test_is_green(tmp_path):
    """As in ros_ws; the messages' package has no tests."""
    workspace = ROOT / "ros_ws"
    own = [f"src/{folder.name}" for folder in PYTHON]
    command = ["colcon", f"--log-base={tmp_path / 'log'}", "test", "--build-base", str(tmp_path / "build"), "--base-paths", *own]
    words = ["--event-handlers", "console_direct+", "--return-code-on-test-failure"]
    (tmp_path / "build").mkdir()
    done = subprocess.run([*command, *words], cwd=workspace, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"\b[1-9][0-9]* passed", done.stdout)) == len(own), done.stdout + done.stderr
