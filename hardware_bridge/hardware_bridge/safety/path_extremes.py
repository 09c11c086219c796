# SPDX-License-Identifier: Apache-2.0
"""What a path is, however densely it is sampled: a knot on the line between its neighbours changes nothing here."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.safety.trajectory import Trajectory

_SAME_M = 1e-9
_TURN_M = 1e-6
"""A strut that comes back by less than this has not turned."""


@dataclass(frozen=True)
class Haste:
    """Where a path is most ahead of a constant speed.

    Attributes:
        strut: index from 0.
        over_m: by how much the change is more than the speed permits in that time, in [m].
        change_m: the change, in [m].
        start_s, end_s: when.
    """

    strut: int
    over_m: float
    change_m: float
    start_s: float
    end_s: float


def most_hasty(path: Trajectory, speed_m_s: float, allowed_m: NDArray[np.float64]) -> Haste:
    """The strut that is ahead of `speed_m_s` by most more than its `allowed_m` (6,), over whatever span of time.

    For every strut this is the largest |x(t) - x(s)| - speed (t - s) of all s before t. Both ends of it are knots, whatever lies
    between, and one pass finds it: x - speed t above its least value so far, and the same of -x.
    """
    times = path.times_s[:, None]
    worst: Haste | None = None
    for sign in (1.0, -1.0):
        lead = sign * path.lengths_m - speed_m_s * times
        over = lead - np.minimum.accumulate(lead, axis=0)
        end, strut = (int(index) for index in np.unravel_index(int(np.argmax(over - allowed_m)), over.shape))
        start = int(np.argmin(lead[: end + 1, strut]))
        found = Haste(
            strut,
            float(over[end, strut]),
            float(abs(path.lengths_m[end, strut] - path.lengths_m[start, strut])),
            float(path.times_s[start]),
            float(path.times_s[end]),
        )
        if worst is None or found.over_m - allowed_m[found.strut] > worst.over_m - allowed_m[worst.strut]:
            worst = found
    assert worst is not None
    return worst


def points_along(path: Trajectory, step_m: float, most: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Points of a path: times in [s] (n,) and lengths in [m] (n, 6).

    Both ends, every `step_m` of the way of the strut that goes farthest, and wherever a strut turns; None if that would be more
    than `most`.
    """
    changes = np.abs(np.diff(path.lengths_m, axis=0)).max(axis=1)
    way = np.concatenate(([0.0], np.cumsum(changes)))
    if way[-1] / step_m > most:
        return None
    turns = sorted({knot for strut in range(path.lengths_m.shape[1]) for knot in _turns(path.lengths_m[:, strut])})
    if way[-1] / step_m + len(turns) + 2 > most:
        return None
    marks = np.sort(np.concatenate((np.arange(0.0, way[-1], step_m), way[turns], way[-1:])))
    times = np.interp(marks, way, path.times_s)
    columns = [np.interp(marks, way, path.lengths_m[:, strut]) for strut in range(path.lengths_m.shape[1])]
    return times, np.stack(columns, axis=1)


def _turns(lengths_m: NDArray[np.float64]) -> list[int]:
    """The knots at which one strut goes the other way; where it rests there, the first of them."""
    turns: list[int] = []
    values = lengths_m.tolist()
    low = high = farthest = 0
    direction = 0
    for knot, value in enumerate(values):
        if direction == 0:
            low = knot if value < values[low] - _SAME_M else low
            high = knot if value > values[high] + _SAME_M else high
            if values[high] - values[low] > _TURN_M:
                direction, farthest = (1, high) if high > low else (-1, low)
        elif direction * (value - values[farthest]) > _SAME_M:
            farthest = knot
        elif direction * (values[farthest] - value) > _TURN_M:
            turns.append(farthest)
            direction, farthest = -direction, knot
    return turns
