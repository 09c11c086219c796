# SPDX-License-Identifier: Apache-2.0
"""Who may import whom (pyproject.toml, importlinter): the rules hold, and a wrong import fails them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {
    "sim_core": "sim_core",
    "hardware_bridge": "hardware_bridge",
    **{name: f"ros_ws/src/{name}" for name in ("tensegrity_robot", "tensegrity_lab", "tensegrity_console", "sixstrut_cli")},
}


@pytest.fixture
def checked(tmp_path):
    """Checks a copy of all sources, with a line more in one of them."""
    for name, folder in PACKAGES.items():
        shutil.copytree(ROOT / folder / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "data", "page"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)

    def check(path="", line=""):
        if path:
            with (tmp_path / path).open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as check; check()", "--no-cache"]
        environ = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))}
        return subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=False)

    return check


def test_every_import_goes_downwards(checked):
    result = checked()
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize(
    ("path", "line", "broken"),
    [
        ("sim_core/structure/topology.py", "import sim_core.rolling.roll", "rooms of sim_core"),
        ("hardware_bridge/driver/engine.py", "import sim_core.dynamics.robot", "hardware_bridge without the model"),
        ("hardware_bridge/safety/limits.py", "def late():\n    import hardware_bridge.driver.engine", "rooms of hardware_bridge"),
        ("hardware_bridge/recording/journal.py", "def late():\n    import rclpy", "no ROS below tensegrity_robot"),
        ("tensegrity_robot/ros/qos.py", "import tensegrity_robot.bridge.observer", "rooms of tensegrity_robot"),
        ("tensegrity_lab/terminal/keys.py", "import tensegrity_lab.studies.demo", "rooms of tensegrity_lab"),
        ("tensegrity_robot/ros/qos.py", "import tensegrity_lab.stack.processes", "packages"),
        ("tensegrity_lab/terminal/keys.py", "import sixstrut_cli.app", "packages"),
    ],
)
def test_a_wrong_import_is_found(checked, path, line, broken):
    result = checked(path, line)
    assert result.returncode == 1
    assert f"{broken} BROKEN" in " ".join(result.stdout.split())
