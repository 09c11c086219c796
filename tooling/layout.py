# SPDX-License-Identifier: Apache-2.0
"""Where set-up puts things, and the error it raises."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


class SetupError(Exception):
    """Set-up cannot go on. The text says what is wrong and what to do."""


@dataclass(frozen=True)
class Layout:
    """The paths of one checkout."""

    root: Path

    def lock(self, group: str) -> Path:
        """Of one group of packages, see `packages.GROUPS`."""
        return self.root / "requirements" / f"{group}.lock"

    @property
    def venv(self) -> Path:
        """The virtual environment."""
        return self.root / ".venv"

    @property
    def venv_python(self) -> Path:
        """Its interpreter."""
        return self.venv / "bin" / "python"

    @property
    def workspace(self) -> Path:
        """The ROS workspace."""
        return self.root / "ros_ws"

    @property
    def sources(self) -> Path:
        """The workspace's sources."""
        return self.workspace / "src"

    @property
    def install(self) -> Path:
        """Where the workspace is installed."""
        return self.workspace / "install"

    @property
    def state(self) -> Path:
        """Set-up's own files: its log, its lock file, the interpreter it used."""
        return self.root / ".sixstrut"

    @property
    def log(self) -> Path:
        """What set-up's commands printed."""
        return self.state / "setup.log"

    @property
    def chosen_python(self) -> Path:
        """Path of the interpreter of the last finished set-up, for the launcher."""
        return self.state / "python"
