# SPDX-License-Identifier: Apache-2.0
"""The loop that joins port, board, body and observer in robot time."""

import logging
import secrets
import select
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.driver.robot_clock import RobotClock
from hardware_bridge.errors import PrototypeError
from hardware_bridge.prototype_client.handshake import faults_path, observer_path
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Outputs
from hardware_bridge.virtual_prototype.body import SimulatedBody
from hardware_bridge.virtual_prototype.fault_server import Faults
from hardware_bridge.virtual_prototype.imu_line import ImuLine
from hardware_bridge.virtual_prototype.observer_server import PERIOD_S, Observer
from hardware_bridge.virtual_prototype.pty_port import PseudoPort

_log = logging.getLogger(__name__)

SLICE_S = 0.01
"""Robot time between looks at the outputs."""

CHUNK_S = 0.1
"""The most robot time that the body catches up with before the port is served again."""

_MOST_WAITING_BYTES = 256
_WAIT_S = 0.02
_LAG_S = 2.0


class VirtualPrototype:
    """A robot behind `link`, alive from construction to `close`.

    The serial side keeps up with the clock; the body may fall behind (a slow computer, a stall) and then catches up in
    chunks, obeying each order at the robot time at which the board got it. So a body that is behind falsifies nothing. Bytes
    that are taken late do: the computer had no time for this process; observations tell (`late_s`).

    Args:
        link: where the pty is linked; see `prototype_client.handshake` for the files beside it.
        body: what the outputs drive.
        calibration: the prototype's own, true one.
        board: what takes the bytes.
        time_scale: robot seconds per second.
        imu: in its box, if there is one.

    Raises:
        PrototypeError: the link is taken, or cannot be made.
    """

    def __init__(
        self,
        link: Path,
        body: SimulatedBody,
        calibration: Calibration,
        board: EmulatedBoard,
        time_scale: float = 1.0,
        imu: ImuLine | None = None,
    ) -> None:
        self._imu = imu
        self._body = body
        self._calibration = calibration
        self._board = board
        self._outputs = Outputs()
        self._targets_m = np.full(6, np.nan)
        self._time_scale = time_scale
        self._port = PseudoPort(link)
        try:
            self._observer = Observer(observer_path(link))
            self._clock = RobotClock(time_scale)
            self._served_s = self._now_s()
            identity = {
                "instance": f"v{secrets.token_hex(8)}",  # never a number, for whoever writes it into YAML
                "device": self._port.device,
                "time_scale": time_scale,
                "board": self._board.spec,
            }
            self._faults = Faults(faults_path(link), self._port, self._board, identity, imu)
        except OSError as error:
            self._port.close()
            raise PrototypeError(str(link), error.strerror or str(error)) from error
        self._observe_s = 0.0
        self._late_s = 0.0
        self._lag_told = False

    def run(self, ended: Callable[[], bool]) -> None:
        """Lives until `ended` says so; it is asked at least every 50 ms."""
        while not ended():
            self.turn()

    def turn(self) -> None:
        """One round: bytes in, replies out, a chunk of the body's time, observations. Waits less than 50 ms."""
        slack_s = (self._body.time_s + SLICE_S - self._now_s()) / self._time_scale
        full = self._board.waiting_bytes >= _MOST_WAITING_BYTES
        readers: list[PseudoPort | Observer | Faults] = [self._observer, self._faults, *([] if full else [self._port])]
        wait_s = min(max(slack_s, 0.0), _WAIT_S)
        due_s = self._served_s + wait_s * self._time_scale
        readable, _, _ = select.select(readers, [], [], wait_s)
        if self._observer in readable:
            self._observer.accept()
        now_s = self._now_s()
        self._late_s, self._served_s = max(self._late_s, now_s - due_s), now_s
        if self._faults in readable:
            self._faults.attend(now_s)
        if self._port in readable:
            self._faults.to_board.put(self._port.read(_MOST_WAITING_BYTES), now_s)
        self._board.receive(self._faults.to_board.take(now_s), now_s)
        self._faults.from_board.put(self._board.process(now_s), now_s)
        reply = self._faults.from_board.take(now_s)
        if reply:
            self._port.write(reply)
        self._advance_body(min(now_s, self._body.time_s + CHUNK_S))
        self._attend_supply(now_s)
        self._tell_lag(now_s - self._body.time_s)

    def close(self) -> None:
        """Removes everything that was put beside the link, and the link."""
        self._observer.close()
        self._faults.close()
        self._port.close()
        if self._imu is not None:
            self._imu.close()

    def _attend_supply(self, now_s: float) -> None:
        """The board hangs on the same supply as the motors: it tells the voltage, and resets when that is too low."""
        supply_v = self._faults.supply_v(self._body.supply_v, now_s)
        if supply_v is not None:
            self._board.battery_mv = round(supply_v * 1e3)
        if self._body.take_brown_out():
            _log.warning("the supply broke down under the motors' load: the board resets")
            self._board.reset(now_s)

    def _tell_lag(self, lag_s: float) -> None:
        """Once for each time that the body falls behind: what is then seen of it is older than it looks."""
        if lag_s > _LAG_S and not self._lag_told:
            _log.warning("the body is %.1f s of robot time behind: lower the time scale, or free the computer", lag_s)
        self._lag_told = lag_s > _LAG_S or (self._lag_told and lag_s > CHUNK_S)

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9

    def _advance_body(self, until_s: float) -> None:
        orders = self._board.orders
        while self._body.time_s + SLICE_S <= until_s:
            time_s = self._body.time_s + SLICE_S
            while orders and orders[0][0] <= time_s:
                at_s, order = orders.popleft()
                self._outputs.follow(order, at_s)
            self._targets_m = self._faults.stalled(self._commanded_m(time_s), self._targets_m)
            self._body.set_targets(self._targets_m)
            before_s = self._body.time_s
            self._body.advance_to(time_s + 1e-9)
            if self._imu is not None:
                self._imu.advance(self._body.time_s)
            if self._body.time_s >= self._observe_s:
                self._observe_s += PERIOD_S
                self._observer.tell(replace(self._body.observe(), late_s=self._late_s))
                self._late_s = 0.0
            if self._body.time_s <= before_s:
                return

    def _commanded_m(self, time_s: float) -> NDArray[np.float64]:
        outputs, channels = self._outputs, self._calibration.channels
        return np.array([self._calibration.length_m(*each) for each in enumerate(outputs.pulse_us(on, time_s) for on in channels)])
