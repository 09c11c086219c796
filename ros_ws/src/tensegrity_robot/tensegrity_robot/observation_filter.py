"""Which of an observer's twenty observations a second are news. Knows no ROS."""

from __future__ import annotations


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
