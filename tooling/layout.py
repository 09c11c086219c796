# SPDX-License-Identifier: Apache-2.0
"""Where set-up puts things, and the error it raises."""

from pathlib import Path


class SetupError(Exception):
    """Set-up cannot go on. The text says what is wrong and what to do."""


class Layout:
    """The paths of one checkout."""

    def __init__(self, root: Path):
        self.root = root
        self.venv = root / ".venv"
        self.venv_python = self.venv / "bin" / "python"
        self.workspace = root / "ros_ws"
        self.sources = self.workspace / "src"
        self.without_ros = self.workspace / "without_ros"  # packages that the ROS wheels lack
        self.install = self.workspace / "install"
        self.state = root / ".sixstrut"  # set-up's own files
        self.log = self.state / "setup.log"  # what its commands printed
        self.chosen_python = self.state / "python"  # names the interpreter of the last finished set-up, for the launcher

    def lock(self, group: str) -> Path:
        """Of one group of packages, see `packages.GROUPS`."""
        return self.root / "requirements" / f"{group}.lock"
