# SPDX-License-Identifier: Apache-2.0
"""The line between port and board, with the faults of a radio link: bytes lost, changed, late, or sent by nobody."""

from __future__ import annotations

from collections import deque

MOVE_BYTES = 20
"""What comes at once and is no shorter is a move; queries are much shorter on every board."""

_CHANGED_BITS = 0x5A
_NOBODYS = 0x55
_FOREVER = -1


class Direction:
    """One way of the line. Times are robot time in [s]."""

    def __init__(self) -> None:
        self._drop = 0
        self._corrupt = 0
        self._cut = False
        self._delay_s = 0.0
        self._late: deque[tuple[float, bytes]] = deque()

    def drop(self, count: int) -> None:
        """Loses the next bytes; 0: all."""
        self._drop = count or _FOREVER

    def corrupt(self, count: int) -> None:
        """Changes the next bytes; 0: all."""
        self._corrupt = count or _FOREVER

    def delay(self, seconds: float) -> None:
        """Holds back what comes from now on."""
        self._delay_s = seconds

    def cut(self) -> None:
        """Loses the second half of the next move."""
        self._cut = True

    def extra(self, count: int, now_s: float) -> None:
        """Bytes that nobody sent."""
        self._late.append((now_s, bytes((_NOBODYS,)) * count))

    def clear(self) -> None:
        """No faults any more; what is late still arrives, at once."""
        self._drop = self._corrupt = 0
        self._cut, self._delay_s = False, 0.0
        self._late = deque((0.0, data) for _, data in self._late)

    def put(self, data: bytes, now_s: float) -> None:
        """Bytes that go in now."""
        if self._cut and len(data) >= MOVE_BYTES:
            self._cut, data = False, data[: len(data) // 2]
        if self._drop:
            lost = len(data) if self._drop == _FOREVER else min(self._drop, len(data))
            self._drop -= 0 if self._drop == _FOREVER else lost
            data = data[lost:]
        if self._corrupt:
            bad = len(data) if self._corrupt == _FOREVER else min(self._corrupt, len(data))
            self._corrupt -= 0 if self._corrupt == _FOREVER else bad
            data = bytes(byte ^ _CHANGED_BITS for byte in data[:bad]) + data[bad:]
        if data:
            self._late.append((now_s + self._delay_s, data))

    def take(self, now_s: float) -> bytes:
        """Bytes that come out now."""
        out = b""
        while self._late and self._late[0][0] <= now_s:
            out += self._late.popleft()[1]
        return out
