# SPDX-License-Identifier: Apache-2.0
"""What is worth keeping: which of an observer's observations are news, which events are of this stream. Knows no ROS."""


class ObservationFilter:
    """News: the face, or whether the robot rests on it, has changed; or it rests there still after struts were moved."""

    def __init__(self) -> None:
        self._told: tuple[str | None, bool] | None = None
        self._moved = False

    def moved(self) -> None:
        """Something was written to the board. May be called from any thread."""
        self._moved = True

    def is_news(self, face: str | None, settled: bool) -> bool:
        """Whether to tell this observation; it then counts as told."""
        moved = self._moved and settled
        if (face, settled) == self._told and not moved:
            return False
        if settled:
            self._moved = False
        self._told = (face, settled)
        return True


class EventTimes:
    """Robot times of the newest events: tells an event of this stream from one with the same number in another."""

    MOST = 20_000

    def __init__(self) -> None:
        self._times_ns: dict[int, int] = {}

    def add(self, seq: int, robot_time_ns: int) -> None:
        """An event. May be called from any thread, one at a time."""
        self._times_ns[seq] = robot_time_ns
        if len(self._times_ns) > self.MOST:
            del self._times_ns[next(iter(self._times_ns))]

    def has(self, seq: int, robot_time_ns: int) -> bool:
        """Whether an event with this number happened at this time."""
        return self._times_ns.get(seq) == robot_time_ns
