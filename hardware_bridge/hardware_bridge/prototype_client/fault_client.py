# SPDX-License-Identifier: Apache-2.0
"""Telling a virtual prototype to fail, through the Unix socket beside its link. For tests; a real robot has no such thing.

One connection, one request: a line of JSON in, a line of JSON back. What exists is in `FAULTS`; `clear` ends all
that last. To `{"who": NONCE}` it says who it is, see `handshake`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from hardware_bridge.errors import PrototypeError
from hardware_bridge.prototype_client.handshake import ask, faults_path

TO_BOARD, FROM_BOARD = "to_board", "from_board"


class Option(NamedTuple):
    """A number that a fault takes: its range, and the value if it is not given."""

    low: float
    high: float
    default: float


COUNT = {"count": Option(0, 1_000_000, 0)}

FAULTS: Mapping[str, tuple[bool, Mapping[str, Option]]] = {
    # name: (whether it needs a direction, its numbers)
    "drop": (True, COUNT),  # the next `count` bytes get lost; 0: all, until clear
    "corrupt": (True, COUNT),  # the next `count` bytes arrive with other bits; 0: all, until clear
    "delay": (True, {"seconds": Option(0.0, 60.0, 0.5)}),  # bytes arrive this much later, in robot time, until clear
    "extra": (True, {"count": Option(1, 1000, 8)}),  # so many bytes arrive that nobody sent
    "cut": (False, {}),  # the second half of the next move's frame gets lost
    "stuck": (False, {}),  # the port takes no more bytes, until clear
    "reset": (False, {}),  # the board loses its power for a moment
    "brown_out": (False, {"volts": Option(0.0, 60.0, 5.0), "seconds": Option(0.1, 600.0, 5.0)}),  # sags, and resets the board
    "battery": (False, {"volts": Option(0.0, 60.0, 6.0)}),  # the supply has this voltage, until clear
    "stall": (False, {"strut": Option(1, 6, 1)}),  # the strut stays where it was last sent, until clear
    "imu_unplugged": (False, {}),  # the inertial sensor's port vanishes, until clear
    "imu_frozen": (False, {}),  # the inertial sensor repeats its last figures, until clear
    "imu_turned": (False, {"degrees": Option(1.0, 180.0, 60.0)}),  # it slips in its mount, for good
    "clear": (False, {}),
}


def check_fault(request: object) -> tuple[str, str, dict[str, float]]:
    """Fault, direction (empty where it has none) and numbers of a request.

    Raises:
        ValueError: it is none; says what is valid.
    """
    if not isinstance(request, Mapping) or request.get("fault") not in FAULTS:
        raise ValueError(
            f"fault is {request.get('fault') if isinstance(request, Mapping) else request!r}, valid: {', '.join(FAULTS)}"
        )
    name = str(request["fault"])
    directed, options = FAULTS[name]
    direction = request.get("direction", "")
    if directed != (direction in (TO_BOARD, FROM_BOARD)) or (direction and not directed):
        raise ValueError(f"direction of {name} is {direction!r}, valid: {f'{TO_BOARD}, {FROM_BOARD}' if directed else 'none'}")
    unknown = set(request) - {"fault", "direction", *options}
    if unknown:
        raise ValueError(f"{name} takes no {', '.join(sorted(unknown))}")
    numbers = {key: request.get(key, option.default) for key, option in options.items()}
    for key, value in numbers.items():
        low, high, _ = options[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise ValueError(f"{key} of {name} is {value!r}, valid is {low:g} to {high:g}")
    return name, direction, numbers


def inject(link: Path, fault: str, direction: str = "", **numbers: float) -> float:
    """Makes the virtual prototype behind `link` fail; the robot time in [s] of its own clock at which it began to.

    Raises:
        PrototypeError: nobody is there, or there is no such fault.
    """
    request = {"fault": fault, **({"direction": direction} if direction else {}), **numbers}
    try:
        _, answer = ask(faults_path(link), request)
    except (OSError, ValueError) as error:
        raise PrototypeError(str(link), f"takes no faults ({error}); is a virtual prototype running there?") from error
    if "robot_time_s" not in answer:
        raise PrototypeError(str(link), str(answer.get("error", "did not answer")))
    return float(answer["robot_time_s"])
