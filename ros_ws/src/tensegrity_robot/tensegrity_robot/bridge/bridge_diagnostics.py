# SPDX-License-Identifier: Apache-2.0
"""The bridge's health in words, for `/diagnostics`: names as REP 107 asks, "node: what"."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import NamedTuple

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from hardware_bridge.driver.events import Snapshot
from hardware_bridge.link.board_link import LATE_ANSWER_S
from hardware_bridge.link.latency import Percentiles
from tensegrity_interfaces.msg import BridgeState

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE

SLOW_WRITE_S = 0.02
"""A frame of six servos lasts 26 ms at 9600 baud; handing it over must be much quicker than that, or frames will be late."""


class LogFacts(NamedTuple):
    """A bag as diagnostics tell it.

    Attributes:
        most_waiting: messages that ever waited for the disk at once.
        free_mb: free space where it is, in MB.
        trouble: why nothing is moved with it; empty: it is well.
        dropped: messages of other nodes that were over their topic's quota.
    """

    path: str
    messages: int
    most_waiting: int
    free_mb: float
    trouble: str
    dropped: int = 0


def diagnostics(
    node: str, snapshot: Snapshot | None, log: LogFacts | None, observer: bool | None, stalled: str, hint: str, stamp: Time
) -> DiagnosticArray:
    """What is well and what is not.

    Args:
        node: name of the bridge's node.
        snapshot: of the bridge; None: there is no bridge.
        log: of the bag; None: not recording.
        observer: whether the observer is there; None: none is expected.
        stalled: which strut it sees elsewhere than it was sent; empty: none.
        hint: what to do while there is no bridge.
        stamp: ROS time.
    """
    if snapshot is None:
        return DiagnosticArray(header=Header(stamp=stamp), status=[_status(f"{node}: link", STALE, hint, "", ())])
    statuses = [
        _link(node, snapshot),
        _supervisor(node, snapshot),
        _frames(node, snapshot),
        _duty(node, snapshot),
        _supply(node, snapshot),
        _board(node, snapshot),
        _log(node, log, snapshot.port),
    ]
    if observer is not None:
        told = stalled or ("is there" if observer else "is not there: faces are only predicted")
        statuses.append(_status(f"{node}: observer", OK if observer and not stalled else WARN, told, snapshot.port, ()))
    return DiagnosticArray(header=Header(stamp=stamp), status=statuses)


def _link(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    latency, replies = snapshot.write_latency, snapshot.replies
    level, told = OK, "open"
    if not snapshot.link_ok:
        level, told = ERROR, "lost: check power and link, then reset"
    elif replies.latency.p99_s > LATE_ANSWER_S:
        level, told = WARN, f"slow: a reply in a hundred takes {replies.latency.p99_s * 1e3:.0f} ms; check Bluetooth's range"
    elif latency.p99_s > SLOW_WRITE_S:
        level, told = WARN, f"slow: one frame in a hundred takes {latency.p99_s * 1e3:.0f} ms to hand over; check Bluetooth's range"
    values = (
        ("port", snapshot.port),
        ("virtual", snapshot.virtual_port),
        ("robot", snapshot.robot or "the calibration names none"),
        ("calibration", snapshot.calibration_hash),
        ("frames sent", snapshot.frames_sent),
        ("write errors", snapshot.write_errors),
        ("times opened again", snapshot.reopened),
        *_percentiles("writes", latency),
        ("questions asked", replies.questions),
        ("questions asked again", replies.unanswered),
        ("bad replies", replies.bad),
        *_percentiles("replies", replies.latency),
    )
    return _status(f"{node}: link", level, told, snapshot.port, values)


def _percentiles(of: str, latency: Percentiles) -> list[tuple[str, str]]:
    parts = (("median", latency.median_s), ("95 %", latency.p95_s), ("99 %", latency.p99_s), ("largest", latency.largest_s))
    return [(f"latency of {of}, {part} [ms]", f"{seconds * 1e3:.2f}") for part, seconds in parts]


def _supervisor(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    level = {BridgeState.FAULT: ERROR, BridgeState.HOLD: WARN}.get(str(snapshot.mode), OK)
    told = f"{snapshot.mode}: {snapshot.reason}" if snapshot.reason else str(snapshot.mode)
    values = (("lease holder", snapshot.lease_holder or "nobody"), ("homed", snapshot.homed), ("moving", snapshot.moving))
    return _status(f"{node}: supervisor", level, told, snapshot.port, values)


def _frames(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    level = WARN if snapshot.congested_periods else OK
    told = "held back because the link was slow" if snapshot.congested_periods else "on time"
    values = (("late periods", snapshot.late_periods), ("congested periods", snapshot.congested_periods))
    return _status(f"{node}: frames", level, told, snapshot.port, values)


def _duty(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    left_s, limit_s = snapshot.duty_left_s, snapshot.duty_limit_s
    spent = left_s <= 0.1 * limit_s
    told = "nearly spent: let the actuators rest" if spent else "enough left"
    if not snapshot.duty_known:
        told = "nobody knows how long the struts ran lately, so it counts as spent: let them rest, or give rested_s at the start"
    values = (("duty left [s]", f"{left_s:.1f}"), ("duty budget [s]", f"{limit_s:g}"))
    return _status(f"{node}: duty", WARN if spent else OK, told, snapshot.port, values)


def _supply(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    if snapshot.battery_mv is None:
        return _status(f"{node}: battery", OK, "the board has not told its supply", snapshot.port, ())
    supply_v = snapshot.battery_mv * 1e-3
    low = supply_v < snapshot.supply_low_v
    told = f"low: {supply_v:.2f} V, no gait below {snapshot.supply_low_v:g} V; charge it" if low else f"{supply_v:.2f} V"
    values = (("servo supply [V]", f"{supply_v:.2f}"), ("limit [V]", f"{snapshot.supply_low_v:g}"))
    return _status(f"{node}: battery", WARN if low else OK, told, snapshot.port, values)


def _board(node: str, snapshot: Snapshot) -> DiagnosticStatus:
    errors = snapshot.board_errors
    level, told = OK, "has told no error"
    if errors:
        level, told = ERROR, "; ".join(errors)
    elif not snapshot.answered:
        level, told = WARN, "has never answered since the port was opened: check its supply, port, rate and wiring"
    return _status(f"{node}: board", level, told, snapshot.port, (("errors", len(errors)), ("answered", snapshot.answered)))


def _log(node: str, log: LogFacts | None, port: str) -> DiagnosticStatus:
    if log is None:
        return _status(f"{node}: log", OK, "not recording", port, ())
    values = (
        ("bag", log.path),
        ("messages", log.messages),
        ("most waiting", log.most_waiting),
        ("free space [MB]", f"{log.free_mb:.0f}"),
        ("not recorded, over quota", log.dropped),
    )
    return _status(f"{node}: log", ERROR if log.trouble else OK, log.trouble or "growing", port, values)


def _status(name: str, level: bytes, told: str, hardware: str, values: Sequence[tuple[str, object]]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values]
    short = PurePath(hardware).name  # viewers write it before every name; the link's values have the whole path
    return DiagnosticStatus(level=level, name=name, message=told, hardware_id=short, values=pairs)
