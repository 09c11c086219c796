# SPDX-License-Identifier: Apache-2.0
"""A ledger's line as the message that goes into the bag, and back. The only module of trials that knows ROS types."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_reader import read_session
from sim_core.structure.policy import in_stages
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.ledger_line import ADDED, Event, Line, Outcome, utc_ns, utc_text

TOPIC = "bridge/trial"
_SAME = [f.name for f in fields(Line) if f.name not in ("recorded", "began")]
_BEFORE = [name for name in _SAME if name not in ADDED]


def message_of(line: Line) -> Any:
    """The TrialRecord of a line."""
    from builtin_interfaces.msg import Time

    from tensegrity_interfaces.msg import TrialRecord

    *via, last = in_stages(line.policy_mm)
    plain = {name: _plain(getattr(line, name)) for name in _SAME}
    message = TrialRecord(**plain | {"policy_mm": list(last), "via_mm": list(via[0]) if via else [0] * 6})
    for stamp, text in ((message.header.stamp, line.recorded), (message.began, line.began)):
        time_ns = utc_ns(text) if text else 0
        assert isinstance(stamp, Time)
        stamp.sec, stamp.nanosec = divmod(time_ns, 1_000_000_000)
    return message


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Event | Outcome) else list(value) if isinstance(value, tuple) else value


def line_of_message(message: Any) -> Line:
    """The line of a TrialRecord, decoded by anybody."""
    values = {name: getattr(message, name) for name in _BEFORE}
    values |= {"chain": str(getattr(message, "chain", "")), "rolls": int(getattr(message, "rolls", 0))}  # not in bags of before
    values |= {"event": Event(message.event), "outcome": Outcome(message.outcome)}
    via = [int(v) for v in getattr(message, "via_mm", ())]
    policy = (*(via if any(via) else ()), *(int(v) for v in message.policy_mm))
    values |= {"policy_mm": policy, "faces": tuple(str(v) for v in message.faces)}
    return Line(**values, recorded=_text(message.header.stamp), began=_text(message.began))


def _text(stamp: Any) -> str:
    time_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    return utc_text(time_ns) if time_ns else ""


def lines_in_bag(path: Path) -> list[Line]:
    """Trials in a bag, in order. Raises SessionError: it cannot be read."""
    try:
        return [line_of_message(message) for message in read_session(path, topics=[TOPIC]).of(TOPIC)]
    except (BagError, TypeError, ValueError, OverflowError) as error:
        raise SessionError(f"cannot read the trials in bag {path}: {error}") from error
