# SPDX-License-Identifier: Apache-2.0
"""Whether a frame would only queue behind others: then it is not sent, and the motion goes on later."""

from __future__ import annotations

from hardware_bridge.link.board_link import Link

PORT_LIMIT_S = 0.5
"""Longest wall time for which the port may keep its bytes to itself before the link is lost."""


class Congestion:
    """Looks at a link before every frame.

    Attributes:
        periods: periods without a frame so far.
    """

    def __init__(self) -> None:
        self.periods = 0
        self._since_s: float | None = None

    def look(self, link: Link, now_s: float) -> bool:
        """Whether the port still holds the frame before, or the board's answer is late; `now_s` is wall time.

        Raises:
            LinkLost: the port has sent nothing on for `PORT_LIMIT_S`. A late answer has a limit of its own, see `Link`.
        """
        if not link.is_congested():
            self._since_s = None
            late = link.is_late(now_s)
            self.periods += late
            return late
        self.periods += 1
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s > PORT_LIMIT_S:
            raise link.lost(f"has sent nothing on for {PORT_LIMIT_S:g} s")
        return True
