# SPDX-License-Identifier: Apache-2.0
"""The line between port and board, with the faults of a radio link: bytes lost, changed, late, or sent by nobody."""

from collections import deque

MOVE_BYTES = 20
"""What comes at once and is no shorter is a move; queries are much shorter on every board."""

_CHANGED_BITS = 0x5A
_NOBODYS = 0x55


class Direction:
    """One way of the line. Times are robot time in [s].

    Attributes:
        drop, corrupt: how many of the next bytes are lost, or changed; infinite: all until `clear`.
        cut: the second half of the next move is lost.
        delay_s: what comes from now on is so much later.
    """

    def __init__(self) -> None:
        self._late: deque[tuple[float, bytes]] = deque()
        self.clear()

    def clear(self) -> None:
        """No faults any more; what is late still arrives, at once."""
        self.drop = self.corrupt = 0.0
        self.cut, self.delay_s = False, 0.0
        self._late = deque((0.0, data) for _, data in self._late)

    def extra(self, count: int, now_s: float) -> None:
        """Bytes that nobody sent."""
        self._late.append((now_s, bytes((_NOBODYS,)) * count))

    def put(self, data: bytes, now_s: float) -> None:
        """Bytes that go in now."""
        if self.cut and len(data) >= MOVE_BYTES:
            self.cut, data = False, data[: len(data) // 2]
        lost = int(min(self.drop, len(data)))
        self.drop -= lost
        data = data[lost:]
        bad = int(min(self.corrupt, len(data)))
        self.corrupt -= bad
        data = bytes(byte ^ _CHANGED_BITS for byte in data[:bad]) + data[bad:]
        if data:
            self._late.append((now_s + self.delay_s, data))

    def take(self, now_s: float) -> bytes:
        """Bytes that come out now."""
        out = b""
        while self._late and self._late[0][0] <= now_s:
            out += self._late.popleft()[1]
        return out
