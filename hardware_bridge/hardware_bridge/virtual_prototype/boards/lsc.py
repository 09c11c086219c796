# SPDX-License-Identifier: Apache-2.0
"""An emulated LSC board.

* Only a battery query is answered.
* A frame with a channel or pulse that no LSC accepts is ignored whole, and so are unknown commands.
* After a cut frame the beginning of the next one is taken as the cut one's rest, so both are lost, unless by chance
  they form a valid move. The maker documents no timeout; this is the worse of the two possibilities.
"""

from hardware_bridge.boards.lsc import (
    CMD_BATTERY,
    Frame,
    FrameDecoder,
    decode_move,
    decode_unload,
    encode_battery_reply,
)
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order


class EmulatedLsc(EmulatedBoard):
    """See the module."""

    spec = "lsc"

    def take(self, byte: int, time_s: float) -> bytes:
        """See `EmulatedBoard`."""
        return b"".join(self._obey(frame, time_s) for frame in self._decoder.feed(bytes((byte,))))

    def forget(self) -> None:
        """See `EmulatedBoard`."""
        self._decoder = FrameDecoder()

    def _obey(self, frame: Frame, time_s: float) -> bytes:
        if (move := decode_move(frame)) is not None:
            self.order(Order(dict(zip(move.channels, move.pulses_us, strict=True)), move.duration_ms * 1e-3), time_s)
        elif (channels := decode_unload(frame)) is not None:
            self.order(Order(dict.fromkeys(channels)), time_s)
        elif frame == Frame(CMD_BATTERY, b""):
            return encode_battery_reply(self.battery_mv)
        return b""
