# SPDX-License-Identifier: Apache-2.0
"""Rest lengths over time: knots, joined by straight lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardware_bridge.errors import TrajectoryError
from sim_core.names import STRUT_NAMES

MAX_KNOTS = 4000
MAX_DURATION_S = 600.0
CLOSEST_S = 1e-12
"""Least time between knots: closer ones have no slope that a computer can hold."""

_JUMP_S = 1e-9


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Knots of the six rest lengths. Between knots every strut moves at constant speed.

    The motion starts at the present lengths at time 0. A first knot at time 0 that is elsewhere is a jump, for the rules to judge.

    Attributes:
        times_s: robot time of each knot since the start, strictly increasing. Shape (n,).
        lengths_m: absolute rest lengths in [m], S1 first. Shape (n, 6).

    Raises:
        TrajectoryError: wrong shape or order, or not a number, naming strut and knot (from 1).
    """

    times_s: NDArray[np.float64]
    lengths_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        try:
            times = np.array(self.times_s, dtype=np.float64)
            lengths = np.array(self.lengths_m, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TrajectoryError("times and lengths must be numbers, six lengths a knot") from error
        most = MAX_KNOTS + bool(times.size and times.flat[0] == 0.0)
        if times.ndim != 1 or not 1 <= len(times) <= most or lengths.shape != (len(times), len(STRUT_NAMES)):
            shapes = f"times {times.shape} and lengths {lengths.shape}"
            raise TrajectoryError(f"{shapes}, valid are (n,) and (n, 6) with n from 1 to {MAX_KNOTS} after time 0")
        if not (finite := np.isfinite(lengths)).all():
            knot, strut = (int(index) for index in np.argwhere(~finite)[0])
            problem = f"{STRUT_NAMES[strut]} is {lengths[knot, strut]} at knot {knot + 1}, valid is a length in m"
            raise TrajectoryError(problem, STRUT_NAMES[strut], knot + 1)
        good = (times >= 0.0) & (times <= MAX_DURATION_S)
        good[1:] &= np.diff(times) >= CLOSEST_S
        if not good.all():
            knot = int(np.argmin(good)) + 1
            valid = f"from 0 to {MAX_DURATION_S:g} s, each later than the one before"
            raise TrajectoryError(f"time of knot {knot} is {times[knot - 1]:g} s, valid is {valid}", knot=knot)
        times.flags.writeable = False
        lengths.flags.writeable = False
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "lengths_m", lengths)

    def __reduce__(self) -> tuple[object, ...]:
        """What comes over a connection is checked like any other."""
        return Trajectory, (self.times_s, self.lengths_m)

    @classmethod
    def from_names(cls, names: Sequence[str], times_s: ArrayLike, lengths_m: ArrayLike) -> Trajectory:
        """A trajectory whose columns are in the order of `names`, which must be S1 to S6, each once.

        Raises:
            TrajectoryError: wrong names or counts, or as the class.
        """
        if sorted(names) != list(STRUT_NAMES):
            raise TrajectoryError(f"names are {list(names)}, valid are {list(STRUT_NAMES)}, each once")
        try:
            lengths = np.array(lengths_m, dtype=np.float64)
            times = np.array(times_s, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TrajectoryError("times and lengths must be numbers, six lengths a knot") from error
        if lengths.ndim != 2 or lengths.shape[1] != len(STRUT_NAMES):
            raise TrajectoryError(f"lengths have shape {lengths.shape}, valid is (n, 6)")
        return cls(times, lengths[:, [list(names).index(strut) for strut in STRUT_NAMES]])

    @property
    def duration_s(self) -> float:
        """Time of the last knot, in [s]."""
        return float(self.times_s[-1])

    def starting_at(self, lengths_m: Sequence[float]) -> Trajectory:
        """This trajectory with the knot (0, `lengths_m`) in front.

        Its own knot at 0 falls away if it says the same; else it comes at once behind: nothing of the path is lost, so what
        is judged and sent does not depend on where the next knot is.
        """
        present = np.array(lengths_m, dtype=np.float64)
        times, lengths = self.times_s, self.lengths_m
        if times[0] == 0.0 and np.array_equal(lengths[0], present):
            times, lengths = times[1:], lengths[1:]
        elif times[0] == 0.0:
            times = times.copy()
            times[0] = _JUMP_S if len(times) == 1 else min(_JUMP_S, 0.5 * float(times[1]))
        return Trajectory(np.concatenate(([0.0], times)), np.concatenate((present[None], lengths)))

    def at(self, time_s: float) -> NDArray[np.float64]:
        """Lengths in [m] at `time_s`, held beyond the ends. Shape (6,)."""
        times, lengths = self.times_s, self.lengths_m
        if time_s <= times[0]:
            return np.array(lengths[0])
        if time_s >= times[-1]:
            return np.array(lengths[-1])
        right = int(np.searchsorted(times, time_s, side="right"))
        part = (time_s - times[right - 1]) / (times[right] - times[right - 1])
        return np.asarray(lengths[right - 1] + part * (lengths[right] - lengths[right - 1]))
