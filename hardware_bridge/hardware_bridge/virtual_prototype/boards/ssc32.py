# SPDX-License-Identifier: Apache-2.0
"""An emulated SSC-32.

* `QP` answers the pulse that a channel is given, in 10 us, and 0 for a channel without one; `Q` whether one is on its way.
* A line goes on until its CR: a cut one swallows the next, unless `ESC` comes between. A line that is no command is
  ignored whole (assumed).
* A channel's first move ignores its duration and speed, after power-up and after its pulse was off.
* Offsets are kept; analogue inputs and the version are not answered (the SSC-32U has no `VER`).
"""

from hardware_bridge.boards import ssc32
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order


class EmulatedSsc32(EmulatedBoard):
    """See the module."""

    spec = "ssc32"

    def take(self, byte: int, time_s: float) -> bytes:
        """See `EmulatedBoard`."""
        return b"".join(self._obey(command, time_s) for command in self._decoder.feed(bytes((byte,))))

    def forget(self) -> None:
        """See `EmulatedBoard`."""
        self._decoder = ssc32.LineDecoder()
        self._offsets_us: dict[int, int] = {}

    def _obey(self, command: ssc32.Command, time_s: float) -> bytes:
        match command:
            case ssc32.Group():
                self._move(command, time_s)
            case ssc32.Offset(channel, offset_us):
                self._offsets_us[channel] = offset_us
            case ssc32.Stop(channel):
                at_us = self.commanded_us(channel, time_s)
                if at_us is not None:
                    self.order(Order({channel: at_us}), time_s)
            case ssc32.AskMoving():
                return b"+" if self._outputs.is_moving(time_s) else b"."
            case ssc32.AskPulses(channels):
                return ssc32.encode_pulse_reply([self._asked_us(channel, time_s) for channel in channels])
        return b""

    def _move(self, group: ssc32.Group, time_s: float) -> None:
        pulses_us: dict[int, float | None] = {}
        duration_s = (group.duration_ms or 0) * 1e-3  # all stop together, and none is faster than its own speed
        for target in group.targets:
            channel, at_us = target.channel, self.commanded_us(target.channel, time_s)
            if target.pulse_us is None:
                pulses_us[channel] = None
                continue
            pulse_us = pulses_us[channel] = target.pulse_us + self._offsets_us.get(channel, 0)
            if target.speed_us_s and at_us is not None:
                duration_s = max(duration_s, abs(pulse_us - at_us) / target.speed_us_s)
        self.order(Order(pulses_us, duration_s), time_s)

    def _asked_us(self, channel: int, time_s: float) -> float | None:
        pulse_us = self.commanded_us(channel, time_s)
        return None if pulse_us is None else pulse_us - self._offsets_us.get(channel, 0)
