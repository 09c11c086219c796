# SPDX-License-Identifier: Apache-2.0
"""What an observer outside the robot sees, and its one line of JSON."""

import json
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.errors import ObserverError
from sim_core.printable import printable

FAR_M = 1e4
"""No floor is larger."""


@dataclass(frozen=True, eq=False)
class Observation:
    """What a camera above the floor would tell.

    Attributes:
        robot_time_ns: the observer's own robot time, in [ns]; not the bridge's.
        face: base face, or None.
        detail: for people.
        settled: all joints have been slower than the rest speed for 0.2 s.
        joints_m: shape (12, 3), in [m].
        box_m: shape (3,), in [m].
        late_s: how late at worst, in robot time, a virtual prototype on a busy computer took its bytes since the observation
            before; 0 of any other observer.
    """

    robot_time_ns: int
    face: str | None
    detail: str
    settled: bool
    joints_m: NDArray[np.float64]
    box_m: NDArray[np.float64]
    late_s: float = 0.0


def encode_observation(observation: Observation) -> bytes:
    """One line of JSON, with its end."""
    data = {
        "robot_time_ns": observation.robot_time_ns,
        "face": observation.face,
        "detail": observation.detail,
        "settled": observation.settled,
        "nodes_m": observation.joints_m.tolist(),
        "box_m": observation.box_m.tolist(),
        "late_s": round(observation.late_s, 6),
    }
    return json.dumps(data, separators=(",", ":")).encode() + b"\n"


def decode_observation(line: bytes) -> Observation:
    """The observation in a line.

    Raises:
        ObserverError: it is none.
    """
    try:
        data = json.loads(line)
        joints_m = np.array(data["nodes_m"], dtype=np.float64)
        box_m = np.array(data["box_m"], dtype=np.float64)
        if joints_m.shape != (12, 3) or box_m.shape != (3,):
            raise ValueError(f"nodes have shape {joints_m.shape}, valid is (12, 3)")
        if not (np.abs(joints_m) < FAR_M).all() or not (np.abs(box_m) < FAR_M).all():  # also not-a-number
            raise ValueError(f"positions are not within {FAR_M:g} m")
        face = None if data["face"] is None else printable(str(data["face"]), 40)
        detail, settled = printable(str(data.get("detail", ""))), bool(data["settled"])
        late_s = float(data.get("late_s", 0.0))
        if not 0.0 <= late_s < math.inf:
            raise ValueError("late_s is no time")
        return Observation(int(data["robot_time_ns"]), face, detail, settled, joints_m, box_m, late_s)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, AttributeError) as error:
        raise ObserverError(f"a line is no observation ({printable(str(error), 100)}); is it the observer's socket?") from error
