# SPDX-License-Identifier: Apache-2.0
"""A node's health for `/diagnostics`: names as REP 107 asks, "node: what"."""

from collections.abc import Sequence
from pathlib import PurePath
from typing import NamedTuple

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE


class Part(NamedTuple):
    """What is told of one part of the node."""

    name: str
    level: bytes
    told: str
    values: Sequence[tuple[str, object]] = ()


def diagnostics(node: str, port: str, parts: Sequence[Part], stamp: Time) -> DiagnosticArray:
    """The parts of a node as a message."""
    statuses = [
        DiagnosticStatus(
            level=part.level,
            name=f"{node}: {part.name}",
            message=part.told,
            hardware_id=PurePath(port).name,  # viewers write it before every name; the link's values have the whole path
            values=[KeyValue(key=key, value=str(value)) for key, value in part.values],
        )
        for part in parts
    ]
    return DiagnosticArray(header=Header(stamp=stamp), status=statuses)
