# SPDX-License-Identifier: Apache-2.0
"""Between a computer and the robot: servo boards, the serial line, safety, the virtual prototype, bags. Knows no ROS.

The names below are the public ones; `examples/` uses nothing else. A name's module is imported when the name is first used, so
`import hardware_bridge` itself costs nothing. Everything else lives in the rooms (`hardware_bridge.boards`, …).

* `Bridge`: one port with its board, supervisor and stream of events; `with Bridge(port, Rules(load_calibration())) as bridge:`.
* `Rules`, `Limits`, `Calibration`, `load_calibration`, `Board`, `parse_board`: what it is told about robot and board.
* `Trajectory`, `Mode`: what it executes, and the states it goes through.
* `BridgeError`, `Refused`: every error of this package, and the refusal of a command, which moves nothing.
* `practice_prototype`: a virtual prototype of your own, for the length of a `with` block.
* `read_session`, `Session`, `seconds_of`: a recorded bag.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hardware_bridge.boards.board import Board
    from hardware_bridge.boards.registry import parse_board
    from hardware_bridge.calibration.calibration_file import load_calibration
    from hardware_bridge.calibration.pulse_map import Calibration
    from hardware_bridge.driver.bridge import Bridge
    from hardware_bridge.errors import BridgeError, Refused
    from hardware_bridge.recording.bag_reader import Session, read_session, seconds_of
    from hardware_bridge.safety.limit_checks import Rules
    from hardware_bridge.safety.limits import Limits
    from hardware_bridge.safety.supervisor_messages import Mode
    from hardware_bridge.safety.trajectory import Trajectory
    from hardware_bridge.virtual_prototype.practice import practice_prototype

__all__ = [
    "Board",
    "Bridge",
    "BridgeError",
    "Calibration",
    "Limits",
    "Mode",
    "Refused",
    "Rules",
    "Session",
    "Trajectory",
    "load_calibration",
    "parse_board",
    "practice_prototype",
    "read_session",
    "seconds_of",
]

_MODULES = {
    "Board": "boards.board",
    "Bridge": "driver.bridge",
    "BridgeError": "errors",
    "Calibration": "calibration.pulse_map",
    "Limits": "safety.limits",
    "Mode": "safety.supervisor_messages",
    "Refused": "errors",
    "Rules": "safety.limit_checks",
    "Session": "recording.bag_reader",
    "Trajectory": "safety.trajectory",
    "load_calibration": "calibration.calibration_file",
    "parse_board": "boards.registry",
    "practice_prototype": "virtual_prototype.practice",
    "read_session": "recording.bag_reader",
    "seconds_of": "recording.bag_reader",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}: public are {', '.join(__all__)}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
