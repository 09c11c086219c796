# SPDX-License-Identifier: Apache-2.0
"""The bridge's health in words, for `/diagnostics`."""

from hardware_bridge.driver.events import Snapshot
from hardware_bridge.link.board_link import LATE_ANSWER_S
from hardware_bridge.link.latency import Percentiles
from hardware_bridge.recording.log_watch import LogWatch
from hardware_bridge.recording.session_bag import SessionLog
from tensegrity_interfaces.msg import BridgeState
from tensegrity_robot.bridge.observer import Observing
from tensegrity_robot.ros.diagnostics import ERROR, OK, WARN, Part

SLOW_WRITE_S = 0.02
"""A frame of six servos lasts 26 ms at 9600 baud; handing it over must be much quicker than that, or frames will be late."""


def parts_of(snapshot: Snapshot, log: SessionLog | None, watch: LogWatch | None, dropped: int, observing: Observing) -> list[Part]:
    """What is well and what is not. `dropped`: messages of other nodes that were over their topic's quota."""
    parts = [
        _link(snapshot),
        _supervisor(snapshot),
        _frames(snapshot),
        _duty(snapshot),
        _supply(snapshot),
        _board(snapshot),
        _log(log, watch, dropped),
    ]
    if observing.there is not None:
        stalled = observing.stalled(snapshot)
        told = stalled or ("is there" if observing.there else "is not there: faces are only predicted")
        parts.append(Part("observer", OK if observing.there and not stalled else WARN, told))
    return parts


def _link(snapshot: Snapshot) -> Part:
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
    return Part("link", level, told, values)


def _percentiles(of: str, latency: Percentiles) -> list[tuple[str, str]]:
    parts = (("median", latency.median_s), ("95 %", latency.p95_s), ("99 %", latency.p99_s), ("largest", latency.largest_s))
    return [(f"latency of {of}, {part} [ms]", f"{seconds * 1e3:.2f}") for part, seconds in parts]


def _supervisor(snapshot: Snapshot) -> Part:
    level = {BridgeState.FAULT: ERROR, BridgeState.HOLD: WARN}.get(str(snapshot.mode), OK)
    told = f"{snapshot.mode}: {snapshot.reason}" if snapshot.reason else str(snapshot.mode)
    values = (("lease holder", snapshot.lease_holder or "nobody"), ("homed", snapshot.homed), ("moving", snapshot.moving))
    return Part("supervisor", level, told, values)


def _frames(snapshot: Snapshot) -> Part:
    level = WARN if snapshot.congested_periods else OK
    told = "held back because the link was slow" if snapshot.congested_periods else "on time"
    values = (("late periods", snapshot.late_periods), ("congested periods", snapshot.congested_periods))
    return Part("frames", level, told, values)


def _duty(snapshot: Snapshot) -> Part:
    left_s, limit_s = snapshot.duty_left_s, snapshot.duty_limit_s
    spent = left_s <= 0.1 * limit_s
    told = "nearly spent: let the actuators rest" if spent else "enough left"
    if not snapshot.duty_known:
        told = "nobody knows how long the struts ran lately, so it counts as spent: let them rest, or give rested_s at the start"
    values = (("duty left [s]", f"{left_s:.1f}"), ("duty budget [s]", f"{limit_s:g}"))
    return Part("duty", WARN if spent else OK, told, values)


def _supply(snapshot: Snapshot) -> Part:
    if snapshot.battery_mv is None:
        return Part("battery", OK, "the board has not told its supply")
    supply_v = snapshot.battery_mv * 1e-3
    low = supply_v < snapshot.supply_low_v
    told = f"low: {supply_v:.2f} V, no gait below {snapshot.supply_low_v:g} V; charge it" if low else f"{supply_v:.2f} V"
    values = (("servo supply [V]", f"{supply_v:.2f}"), ("limit [V]", f"{snapshot.supply_low_v:g}"))
    return Part("battery", WARN if low else OK, told, values)


def _board(snapshot: Snapshot) -> Part:
    errors = snapshot.board_errors
    level, told = OK, "has told no error"
    if errors:
        level, told = ERROR, "; ".join(errors)
    elif not snapshot.answered:
        level, told = WARN, "has never answered since the port was opened: check its supply, port, rate and wiring"
    return Part("board", level, told, (("errors", len(errors)), ("answered", snapshot.answered)))


def _log(log: SessionLog | None, watch: LogWatch | None, dropped: int) -> Part:
    if log is None or watch is None:
        return Part("log", OK, "not recording")
    values = (
        ("bag", log.path),
        ("messages", log.messages),
        ("most waiting", log.most_waiting),
        ("free space [MB]", f"{watch.free_mb:.0f}"),
        ("not recorded, over quota", dropped),
    )
    return Part("log", ERROR if watch.trouble else OK, watch.trouble or "growing", values)
