"""One strut at a time, by hand: what calibrating needs of a board, with no supervisor, because there is no calibration yet.

A person stands by, and every step is short: at most ``STEP_US`` (about 1 mm) each ``STEP_S``.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from hardware_bridge.codecs import Board
from hardware_bridge.last_pulses import LastPulses
from hardware_bridge.transport import SerialTransport

STEP_US = 10
STEP_S = 0.1
"""Robot time for each step: about 10 mm/s."""


class Jogger:
    """Holds the port; keeps the record of the last pulses, so that the bridge knows later where the struts are.

    Args:
        transport: Opened here, closed by ``close``.
        board: What sits behind the port.
        record: Where the last pulses are kept.
        time_scale: Robot seconds per second.
        wait: Lets wall seconds pass.

    Raises:
        TransportError: The port cannot be used.
    """

    def __init__(
        self,
        transport: SerialTransport,
        board: Board,
        record: LastPulses,
        time_scale: float = 1.0,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._transport = transport
        self._board = board
        self._record = record
        self._time_scale = time_scale
        self._wait = wait
        self._energised: set[int] = set()
        low, high = board.quirks.channels
        channels = range(low, high + 1)
        kept = zip(channels, record.load(channels), strict=True)
        self._pulses_us = {channel: pulse for channel, pulse in kept if pulse is not None}
        transport.open()

    def close(self) -> None:
        """Lets go of the port; the struts hold."""
        self._transport.close()

    def pulse_us(self, channel: int) -> int | None:
        """Last pulse sent to a channel, in [us]; None where nobody knows."""
        return self._pulses_us.get(channel)

    def go(self, channel: int, pulse_us: int) -> int:
        """Moves to a pulse, in short steps; the first move of a channel goes there at full speed, whatever is asked.

        Returns:
            The pulse now: the asked one, or the nearest that the board takes.

        Raises:
            LinkLost: The port failed.
            StateFileError: The last pulses cannot be kept.
        """
        low, high = self._board.quirks.pulse_us
        target = min(max(pulse_us, low), high)
        present = self._pulses_us.get(channel)
        if channel not in self._energised or present is None:
            self._send(channel, target if present is None else present)
            self._energised.add(channel)
        while (present := self._pulses_us[channel]) != target:
            self._send(channel, present + min(max(target - present, -STEP_US), STEP_US))
            self._wait(STEP_S / self._time_scale)
        return target

    def _send(self, channel: int, pulse_us: int) -> None:
        pulses = self._pulses_us | {channel: pulse_us}
        before = self._pulses_us.get(channel, pulse_us)
        self._record.save(list(pulses), list(pulses.values()))
        self._transport.write_all(self._board.encode_move([pulse_us], [channel], round(STEP_S * 1e3), [before]))
        self._pulses_us = pulses
