# SPDX-License-Identifier: Apache-2.0
"""Whether the struts have come to rest, from what is sent and what an observer sees. Knows no ROS."""

from sim_core.twin.rest_detector import STRUTS_HOLD_S

STILL_M = 0.0003
"""A change of length that is none: of what is seen of a strut at rest."""

DRIFT = 1e-3
"""How fast two clocks may part."""


class StillWatch:
    """Whether the struts have come to rest after what was sent last.

    The observer's clock is not the bridge's, and what it tells may be late: how late is counted from the most timely observation,
    but for `DRIFT` between the clocks.
    """

    def __init__(self) -> None:
        self._now_ns: int | None = None
        self._sent_ns = 0
        self._offset_ns: int | None = None
        self._since_ns = self._seen_ns = 0
        self._lengths_m: tuple[float, ...] | None = None

    @property
    def is_still(self) -> bool:
        """No strut has changed its length for `STRUTS_HOLD_S`, all of it after the last frame."""
        return self._seen_ns - max(self._since_ns, self._sent_ns) >= STRUTS_HOLD_S * 1e9

    @property
    def is_after_last_frame(self) -> bool:
        """What was seen last happened after the last frame, as far as anybody can say; before, a robot at rest means nothing."""
        return self._offset_ns is None or self._seen_ns >= self._sent_ns

    def hear(self, robot_time_ns: int, moved: bool) -> None:
        """The bridge's robot time, and whether a frame was sent then."""
        self._now_ns = robot_time_ns
        if moved:
            self._sent_ns = robot_time_ns

    def see(self, observed_ns: int, lengths_m: tuple[float, ...]) -> None:
        """One more observation of the six struts, at the observer's own robot time."""
        if self._now_ns is None:
            return
        offset_ns = self._now_ns - observed_ns
        if self._offset_ns is None:
            self._offset_ns = offset_ns
        drifted_ns = round(DRIFT * abs(observed_ns + self._offset_ns - self._seen_ns))
        self._offset_ns = min(self._offset_ns + drifted_ns, offset_ns)
        self._seen_ns = observed_ns + self._offset_ns
        before = self._lengths_m
        if before is None or any(abs(new - old) > STILL_M for new, old in zip(lengths_m, before, strict=True)):
            self._since_ns, self._lengths_m = self._seen_ns, lengths_m
