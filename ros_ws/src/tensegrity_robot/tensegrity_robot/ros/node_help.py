# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself to `--help`, before ROS starts; and which words it takes beside those of ROS: none."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from rclpy.utilities import remove_ros_args

from tensegrity_robot.ros.errors import StartError
from tensegrity_robot.ros.node_parameters import valid_of

HELP = {"-h", "--help"}


@dataclass(frozen=True)
class About:
    """A node.

    Attributes:
        name: of node and executable.
        text: what it does.
        settings: dataclass of its parameters.
        gives: names that it publishes or serves. takes: that it hears or calls. An action or a service ends with ().
        example: ROS arguments, such as "-p rate_hz:=10.0".
    """

    name: str
    text: str
    settings: Any
    gives: str
    takes: str
    example: str

    def help(self) -> str:
        """Its page."""
        rows = [(f"{row.name} = {_shown(row.default)}", row) for row in fields(self.settings)]
        width = max(len(start) for start, _ in rows)
        told = [f"  {start:<{width}}  {row.metadata['description']}; {valid_of(row)}" for start, row in rows]
        return "\n".join([
            f"{self.name}: {self.text}",
            f"\nexample: ros2 run tensegrity_robot {self.name} --ros-args {self.example}",
            "\nparameters, given as --ros-args -p NAME:=VALUE or --params-file FILE:",
            *told,
            f"\npublishes and serves: {self.gives}",
            f"hears and calls: {self.takes}",
            "names follow the namespace, given as --ros-args -r __ns:=/NAME",
        ])  # fmt: skip

    def asked_for_help(self, words: Sequence[str]) -> bool:
        """Whether a command line, with the program's name, asks for it. Raises StartError: it has words that no node knows."""
        own = remove_ros_args(words)[1:]
        if own and not HELP & set(own):
            remedy = f"parameters are given as --ros-args -p NAME:=VALUE; `{self.name} --help` lists them"
            raise StartError(f"{self.name} does not know {own[0]!r}: {remedy}")
        return bool(own)


def _shown(default: Any) -> str:
    return str(default).lower() if isinstance(default, bool) else str(default) or '""'
