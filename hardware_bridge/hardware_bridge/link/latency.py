# SPDX-License-Identifier: Apache-2.0
"""How long things took lately, as percentiles."""

from collections import deque
from typing import NamedTuple

import numpy as np

KEPT = 1200
"""A minute of frames."""


class Percentiles(NamedTuple):
    """In [s]; all 0 while nothing was measured."""

    median_s: float
    p95_s: float
    p99_s: float
    largest_s: float


class Replies(NamedTuple):
    """How a board answers its liveness queries.

    Attributes:
        questions: asked so far.
        unanswered: of these, had no sound answer before the next one, and were asked again.
        bad: of these, were answered by too many, too few or nonsensical bytes.
        latency: from question to answer; looked for at each frame, so it may read up to a frame's period too much.
    """

    questions: int
    unanswered: int
    bad: int
    latency: Percentiles


class Latency:
    """The last `KEPT` durations. Not for several threads at once."""

    def __init__(self) -> None:
        self._durations_s: deque[float] = deque(maxlen=KEPT)

    def add(self, duration_s: float) -> None:
        """One more, in [s]."""
        self._durations_s.append(duration_s)

    def percentiles(self) -> Percentiles:
        """Of what is kept."""
        return Percentiles(*map(float, np.percentile(self._durations_s or (0.0,), (50, 95, 99, 100))))
