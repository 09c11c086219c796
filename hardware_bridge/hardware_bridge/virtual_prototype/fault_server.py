# SPDX-License-Identifier: Apache-2.0
"""Where a virtual prototype says who it is, and is told to fail (see `prototype_client`)."""

import contextlib
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.prototype_client import private_files
from hardware_bridge.prototype_client.fault_client import TO_BOARD, check_fault
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.imu_line import ImuLine
from hardware_bridge.virtual_prototype.line_faults import Direction
from hardware_bridge.virtual_prototype.pty_port import PseudoPort

_MAX_CLIENTS = 4
_LONGEST_REQUEST = 4096


class Faults:
    """What is wrong with the robot now. All times are robot time in [s]; nothing here waits.

    Args:
        identity: what is said to who asks: instance, device, time scale and board of a `handshake.Handshake`.

    Attributes:
        to_board, from_board: the two ways of the line.
    """

    def __init__(
        self, path: Path, port: PseudoPort, board: EmulatedBoard, identity: Mapping[str, object], imu: ImuLine | None = None
    ) -> None:
        self.to_board, self.from_board = Direction(), Direction()
        self._path = path
        self._identity = identity
        self._port = port
        self._board = board
        self._imu = imu
        self._battery_mv = board.battery_mv
        self._supply_v: float | None = None
        self._sags_until_s = math.inf
        self._stalling: set[int] = set()
        self._stalled_m: dict[int, float] = {}
        self._server = private_files.listen(path, _MAX_CLIENTS)

    def fileno(self) -> int:
        """Readable when somebody has something to tell."""
        return self._server.fileno()

    def attend(self, now_s: float) -> None:
        """Obeys whoever waits; it has sent its line already, or is not listened to."""
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            with client:
                client.settimeout(0.02)
                line = client.recv(_LONGEST_REQUEST)
                client.sendall(json.dumps(self._answer(line, now_s)).encode() + b"\n")

    def supply_v(self, modelled_v: float | None, now_s: float) -> float | None:
        """The supply's voltage with its faults; None: not modelled, and nothing is wrong with it."""
        if now_s > self._sags_until_s:
            self._end_sag()
        return modelled_v if self._supply_v is None else self._supply_v

    def stalled(self, targets_m: NDArray[np.float64], lengths_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Targets now, with struts that are stuck where they were sent last, `lengths_m`. In [m], NaN: no pulse. Shape (6,)."""
        for index in self._stalling:
            if not np.isnan(lengths_m[index]):
                self._stalled_m.setdefault(index, float(lengths_m[index]))
        targets_m = targets_m.copy()
        for index, length_m in self._stalled_m.items():
            if not np.isnan(targets_m[index]):
                targets_m[index] = length_m
        return targets_m

    def close(self) -> None:
        """Ends, and removes the socket's path."""
        self._server.close()
        self._path.unlink(missing_ok=True)

    def _answer(self, line: bytes, now_s: float) -> dict[str, object]:
        try:
            request = json.loads(line)
            if isinstance(request, Mapping) and "who" in request:
                return {**self._identity, "who": request["who"]}
            fault, direction, numbers = check_fault(request)
        except ValueError as error:
            return {"error": str(error)}
        if fault.startswith("imu_"):
            if self._imu is None:
                return {"error": f"{fault} needs an inertial sensor: start the prototype with --imu"}
            self._imu.fail(fault, numbers)
        self._begin(fault, self.to_board if direction == TO_BOARD else self.from_board, numbers, now_s)
        return {"robot_time_s": now_s}

    def _begin(self, fault: str, way: Direction, numbers: dict[str, float], now_s: float) -> None:
        match fault:
            case "drop":
                way.drop = numbers["count"] or math.inf
            case "corrupt":
                way.corrupt = numbers["count"] or math.inf
            case "delay":
                way.delay_s = numbers["seconds"]
            case "extra":
                way.extra(int(numbers["count"]), now_s)
            case "cut":
                self.to_board.cut = True
            case "stuck":
                self._port.hold_back(True)
            case "reset":
                self._board.reset(now_s)
            case "brown_out":
                self._supply_v, self._sags_until_s = numbers["volts"], now_s + numbers["seconds"]
                self._board.reset(now_s)
            case "battery":
                self._supply_v, self._sags_until_s = numbers["volts"], math.inf
            case "stall":
                self._stalling.add(int(numbers["strut"]) - 1)
            case "clear":
                self._clear()

    def _clear(self) -> None:
        self.to_board.clear()
        self.from_board.clear()
        self._port.hold_back(False)
        self._end_sag()
        self._stalling.clear()
        self._stalled_m.clear()
        if self._imu is not None:
            self._imu.mend()

    def _end_sag(self) -> None:
        if self._supply_v is not None:
            self._board.battery_mv = self._battery_mv
        self._supply_v, self._sags_until_s = None, math.inf
