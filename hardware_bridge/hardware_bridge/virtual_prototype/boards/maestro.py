# SPDX-License-Identifier: Apache-2.0
"""An emulated Maestro.

* `Get Position` answers the pulse that a channel is given, 0 without one; `Get Errors` the latched errors, and clears them.
* A byte with its top bit set begins a packet; one that interrupts another packet is a protocol error, and so are data
  that belong to no packet and commands that do not exist. With CRC on, a wrong one is a CRC error and the packet is lost.
* Every error latches its bit and sends every channel home: off, to a pulse at the channel's speed, or nowhere (*ignore*).
* The serial time-out, if set, is such an error: no valid packet for so long, counted from the first one.
* `FF` begins a Mini-SSC packet whatever the protocol, so a noise byte swallows the next two.
* A channel's first target after power-up or off ignores its speed. Targets outside the channel's limits are clipped.
* Speeds are forgotten by a reset. Acceleration is read and not modelled, and there is no script.
"""

from dataclasses import dataclass

from hardware_bridge.boards import maestro as m
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order

PROTOCOL_BIT = m.ERRORS.index("serial protocol")
CRC_BIT = m.ERRORS.index("serial CRC")
TIMEOUT_BIT = m.ERRORS.index("serial time-out")

_DATA_BYTES = {
    m.SET_TARGET: 3, m.SET_SPEED: 3, m.SET_ACCELERATION: 3,
    m.MINI_SSC: 2, m.GET_POSITION: 1, m.GET_MOVING: 0, m.GET_ERRORS: 0, m.GO_HOME: 0, m.STOP_SCRIPT: 0,
}  # fmt: skip
_MINI_SSC_US = (1023.75, 1976.25)


@dataclass(frozen=True)
class ControlCenter:
    """What Pololu's Control Center sets, and the serial line cannot.

    Attributes:
        home_us: where an error sends the channels: a pulse in [us]; 0: off; None: nowhere ("Ignore").
        timeout_s: serial time-out in [s]; None: off, as delivered.
    """

    home_us: float | None = None
    timeout_s: float | None = None


class EmulatedMaestro(EmulatedBoard):
    """See the module."""

    def __init__(self, board: m.Maestro, baud: int = 115200, settings: ControlCenter | None = None) -> None:
        super().__init__(baud)
        self.spec = board.spec
        self._board = board
        self._settings = ControlCenter() if settings is None else settings

    def take(self, byte: int, time_s: float) -> bytes:
        """See `EmulatedBoard`."""
        packet = self._packet
        in_mini_ssc = bool(packet) and packet[0] == m.MINI_SSC
        if byte & 0x80 and not in_mini_ssc:
            if packet:
                self._fail(PROTOCOL_BIT, time_s)
            packet[:] = bytes((byte,))
        elif not packet:
            self._fail(PROTOCOL_BIT, time_s)
        else:
            packet.append(byte)
        return self._try(time_s)

    def forget(self) -> None:
        """See `EmulatedBoard`."""
        self._packet = bytearray()
        self._speeds = dict.fromkeys(range(m.CHANNELS), 0)
        self._targets_us: dict[int, float] = {}
        self._heard_s: float | None = None
        self.errors = 0

    def pass_time(self, now_s: float) -> None:
        """The serial time-out."""
        limit_s = self._settings.timeout_s
        if limit_s is not None and self._heard_s is not None and now_s - self._heard_s > limit_s:
            at_s, self._heard_s = self._heard_s + limit_s, None
            self._fail(TIMEOUT_BIT, at_s)

    # ---- packets ----------------------------------------------------------------------------------------------------

    def _command(self) -> tuple[int, int, int] | None:
        """The command in the packet so far, and where its data begin and end; None while that is not known; 0: there is no such."""
        packet, at = self._packet, 1
        if not packet:
            return None
        command = packet[0]
        if command == m.POLOLU:
            if len(packet) < 3:
                return None
            command, at = packet[2] | 0x80, 3
            if command == m.MINI_SSC:  # it has no form in this protocol
                return command, at, 0
        if command == m.SET_MULTIPLE:
            return (command, at, at + 2 + 2 * packet[at]) if len(packet) > at else None
        return command, at, at + _DATA_BYTES[command] if command in _DATA_BYTES else 0

    def _try(self, time_s: float) -> bytes:
        """Obeys the packet if it is complete."""
        if (found := self._command()) is None:
            return b""
        command, at, end = found
        packet = bytes(self._packet)
        with_crc = self._board.crc and packet[0] != m.MINI_SSC
        if len(packet) < end + with_crc:
            return b""
        self._packet.clear()
        if end == 0:
            self._fail(PROTOCOL_BIT, time_s)
        elif with_crc and m.crc7(packet[:-1]) != packet[-1]:
            self._fail(CRC_BIT, time_s)
        elif packet[0] != m.POLOLU or self._board.device in (None, packet[1]):  # else for another one on the same line
            self._heard_s = time_s
            return self._obey(command, packet[at:end], time_s)
        return b""

    def _obey(self, command: int, data: bytes, time_s: float) -> bytes:
        match command:
            case m.GET_ERRORS:
                word, self.errors = self.errors, 0
                return word.to_bytes(2, "little")
            case m.GET_MOVING:
                return bytes((self._outputs.is_moving(time_s),))
            case m.GO_HOME:
                self._go_home(time_s)
            case m.SET_MULTIPLE:
                for offset in range(data[0]):
                    self._set_target(data[1] + offset, _quarters(data[2 + 2 * offset :]) / m.PER_US, time_s)
            case m.MINI_SSC:
                low, high = _MINI_SSC_US
                self._set_target(data[0], low + (high - low) * min(data[1], 254) / 254, time_s)
            case m.SET_TARGET | m.SET_SPEED | m.GET_POSITION if data[0] not in self._speeds:
                self._fail(PROTOCOL_BIT, time_s)
            case m.SET_TARGET:
                self._set_target(data[0], _quarters(data[1:]) / m.PER_US, time_s)
            case m.SET_SPEED:
                self._set_speed(data[0], _quarters(data[1:]), time_s)
            case m.GET_POSITION:
                return round((self.commanded_us(data[0], time_s) or 0.0) * m.PER_US).to_bytes(2, "little")
        return b""

    def _set_target(self, channel: int, pulse_us: float, time_s: float) -> None:
        if channel not in self._speeds:
            return
        if pulse_us == 0.0:
            self._targets_us.pop(channel, None)
            self.order(Order({channel: None}), time_s)
            return
        low, high = self._board.limits_us
        self._targets_us[channel] = min(max(pulse_us, low), high)
        self._go(channel, time_s)

    def _set_speed(self, channel: int, units: int, time_s: float) -> None:
        self._speeds[channel] = units
        if channel in self._targets_us:
            self._go(channel, time_s)

    def _go(self, channel: int, time_s: float) -> None:
        target_us, speed_us_s = self._targets_us[channel], self._speeds[channel] * m.SPEED_UNIT_US_S
        at_us = self.commanded_us(channel, time_s)
        duration_s = abs(target_us - at_us) / speed_us_s if speed_us_s and at_us is not None else 0.0
        self.order(Order({channel: target_us}, duration_s), time_s)

    # ---- errors -----------------------------------------------------------------------------------------------------

    def _fail(self, bit: int, time_s: float) -> None:
        self.errors |= 1 << bit
        self._go_home(time_s)

    def _go_home(self, time_s: float) -> None:
        home_us = self._settings.home_us
        if home_us is None:
            return
        for channel in list(self._targets_us):  # the others were never used here
            self._set_target(channel, home_us, time_s)


def _quarters(data: bytes) -> int:
    return (data[0] & 0x7F) | (data[1] & 0x7F) << 7
