# SPDX-License-Identifier: Apache-2.0
"""One strut at a time, by hand: what calibrating needs of a board, with no supervisor, because there is no calibration yet.

A person stands by, and every step is short: at most `STEP_US` (about 1 mm) each `STEP_S`.
"""

import time
from collections.abc import Callable

import numpy as np

from hardware_bridge.boards.board import Board
from hardware_bridge.driver.robot_clock import RobotClock
from hardware_bridge.errors import DutyError
from hardware_bridge.link.board_link import first_answer, silence
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.safety.limits import Limits
from hardware_bridge.saved_state.robot_records import Records
from sim_core.names import STRUT_NAMES

STEP_US = 10
STEP_S = 0.1
"""Robot time for each step: about 10 mm/s."""

FIRST_MOVE_S = 5.0
"""Robot time that counts for the first move of a strut of unknown length: a whole stroke at full speed takes no longer."""


class Jogger:
    """Holds the port; keeps the records, so that the bridge knows later where the struts are and how long they have run.

    The transport is opened here and closed by `close`. `silent_board` is the operator's word that this board cannot answer.

    Raises:
        TransportError: the port cannot be used.
        BoardSilent: nobody answers there, and there is no word that this board cannot.
    """

    def __init__(
        self,
        transport: SerialTransport,
        board: Board,
        records: Records,
        limits: Limits,
        time_scale: float = 1.0,
        silent_board: bool = False,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._transport = transport
        self._board = board
        self._records = records
        self._limits = limits
        self._clock = RobotClock(time_scale)
        self._wait = wait
        self._energised: set[int] = set()
        transport.open()
        try:
            if not silent_board and first_answer(transport, board) is None:
                raise silence(transport.port, board, True, "give --silent-board")
        except BaseException:
            transport.close()
            raise
        low, high = board.quirks.channels
        channels = range(low, high + 1)
        kept = zip(channels, records.pulses.load(channels), strict=True)
        self._pulses_us = {channel: pulse for channel, pulse in kept if pulse is not None}
        self.rested(0.0)

    def close(self) -> None:
        """Lets go of the port; the struts hold. Raises StateFileError; the port is closed all the same."""
        try:
            self._records.duty.save(self._duty, self._now_s, force=True)
        finally:
            self._transport.close()

    @property
    def history_is_known(self) -> bool:
        """Whether anybody knows how long the struts have run lately."""
        return self._duty.is_known(self._now_s, self._limits)

    def rested(self, rested_s: float) -> None:
        """The operator's word, before anything has moved: for so long the actuators have rested, in [s] of robot time."""
        self._duty = self._records.duty.load(self._now_s, self._clock.time_scale, rested_s)

    def require_rest(self, strut: int, run_s: float = STEP_S) -> None:
        """Raises DutyError: a strut (from 0) has run too long lately to run for `run_s` more, and how long to wait."""
        limits, now_s = self._limits, self._now_s
        for window_s, budget_s in limits.duty_windows:
            used_s = float(self._duty.used_s(now_s, window_s)[strut])
            if used_s + run_s > budget_s:
                wait_s = self._duty.wait_s(run_s * np.eye(len(STRUT_NAMES))[strut], now_s, limits)
                raise DutyError(STRUT_NAMES[strut], used_s, run_s, budget_s, window_s, wait_s)

    def pulse_us(self, channel: int) -> int | None:
        """Last pulse sent to a channel, in [us]; None where nobody knows."""
        return self._pulses_us.get(channel)

    def go(self, strut: int, channel: int, pulse_us: int) -> int:
        """Moves a strut (from 0) to a pulse, in short steps; its first move goes there at full speed, whatever is asked.

        Returns:
            the pulse now: the asked one, or the nearest that the board takes.

        Raises:
            LinkLost: the port failed.
            StateFileError: the last pulses cannot be kept.
            DutyError: the strut has run too long lately; it holds where it is.
        """
        low, high = self._board.quirks.pulse_us
        target = min(max(pulse_us, low), high)
        present = self._pulses_us.get(channel)
        if channel not in self._energised or present is None:
            self._send(strut, channel, target if present is None else present, FIRST_MOVE_S if present is None else STEP_S)
            self._energised.add(channel)
        while (present := self._pulses_us[channel]) != target:
            self._send(strut, channel, present + min(max(target - present, -STEP_US), STEP_US), STEP_S)
            self._wait(STEP_S / self._clock.time_scale)
        return target

    def becomes(self, calibration_hash: str) -> None:
        """What was measured is this calibration's: the bridge will know where its struts are. Raises StateFileError."""
        self._records.pulses.becomes(calibration_hash, self._pulses_us)

    @property
    def _now_s(self) -> float:
        return self._clock.now().robot_s

    def _send(self, strut: int, channel: int, pulse_us: int, run_s: float) -> None:
        self.require_rest(strut, run_s)
        pulses = self._pulses_us | {channel: pulse_us}
        before = self._pulses_us.get(channel, pulse_us)
        self._records.pulses.save(list(pulses), list(pulses.values()))
        self._duty = self._duty.ran(run_s * np.eye(len(STRUT_NAMES))[strut], self._now_s, self._limits)
        self._records.duty.save(self._duty, self._now_s)
        self._transport.write_all(self._board.encode_move([pulse_us], [channel], round(STEP_S * 1e3), [before]))
        self._pulses_us = pulses
