# SPDX-License-Identifier: Apache-2.0
"""Which bridge is alive, and what of all that is heard is its own: a recording played beside it must mislead nobody. Knows no ROS.

A bridge numbers its sessions with random names. The live one is told by its state: that comes twice a second with the stamp of now,
which a recording's does not have. Events of any other session are strangers'.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

FRESH_S = 2.0
"""What is older when it comes was recorded, or kept for latecomers."""

SILENT_S = 1.5
"""A bridge that has told nothing for so long may have been replaced by another."""

STRANGE_S = 2.0
"""A session that is heard for longer without being the live one is a stranger; shorter, it may be a bridge that has just begun."""

MOST_WAITING = 100
"""Events of one kind, or sessions, that are remembered until it is known whose they are."""


class _Stamp(Protocol):
    sec: int
    nanosec: int


def age_s(stamp: _Stamp, now_ns: int) -> float:
    """How old a stamp is, in s; negative: from the future."""
    return (now_ns - int(stamp.sec) * 1_000_000_000 - int(stamp.nanosec)) * 1e-9


def is_fresh(stamp: _Stamp, now_ns: int) -> bool:
    """Whether something was stamped just now."""
    return abs(age_s(stamp, now_ns)) < FRESH_S


class LiveBridge:
    """Of one listener.

    Attributes:
        session: of the live bridge; None before one was heard.
    """

    def __init__(
        self,
        warn: Callable[[str], None],
        adopted: Callable[[], None] = lambda: None,
        steady_s: Callable[[], float] = time.monotonic,
        strange: Callable[[str], None] = lambda words: None,
    ):
        """Args: warn: told once of strangers; strange: each time. adopted: called when another session is the live one."""
        self.session: str | None = None
        self._warn = warn
        self._adopted = adopted
        self._steady_s = steady_s
        self._on_strange = strange
        self._heard_s = -float("inf")
        self._waiting: dict[type, deque[tuple[Any, Callable[[Any], None]]]] = {}  # by kind: heartbeats must not push out a face
        self._strange: dict[str, float] = {}
        self._warned = False

    def hears(self, state: Any, now_ns: int) -> bool:
        """Whether a BridgeState is the live bridge's. `now_ns`: ROS time."""
        now_s = self._steady_s()
        if not is_fresh(state.header.stamp, now_ns):
            old = age_s(state.header.stamp, now_ns)
            self._tell(f"bridge states {old:.0f} s old are ignored: a recording is played here, or clocks differ")
            return False
        if state.session != self.session:
            if self.session and now_s - self._heard_s < SILENT_S:  # a bridge without a port has none yet: it may get one
                self._is_strange(state.session, now_s)
                return False
            self._adopt(state.session)
        self._heard_s = now_s
        return True

    def takes(self, event: Any, take: Callable[[Any], None]) -> None:
        """Give an event with a session to `take`: now, if it is of the live bridge; when that is known, if it will be; or never."""
        if event.session == self.session:
            take(event)
            return
        self._waiting.setdefault(type(event), deque(maxlen=MOST_WAITING)).append((event, take))
        self._is_strange(event.session, self._steady_s())

    def _adopt(self, session: str) -> None:
        self.session = session
        self._strange.clear()
        self._adopted()
        waiting, self._waiting = self._waiting, {}
        for events in waiting.values():
            for event, take in events:
                if event.session == session:
                    take(event)

    def _is_strange(self, session: str, now_s: float) -> None:
        since_s = self._strange.setdefault(session, now_s)
        if self.session is not None and now_s - since_s > STRANGE_S:
            self._tell(f"session {session or '(none)'} is another bridge's, or a recording: ignored beside {self.session}")
        while len(self._strange) > MOST_WAITING:
            del self._strange[next(iter(self._strange))]

    def _tell(self, words: str) -> None:
        self._on_strange(words)
        if not self._warned:
            self._warned = True
            self._warn(words)
