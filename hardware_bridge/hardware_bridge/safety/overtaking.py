# SPDX-License-Identifier: Apache-2.0
"""A motion that follows another without a stop between."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.safety.supervisor_messages import Motion
from hardware_bridge.safety.trajectory import CLOSEST_S, Trajectory

_SAME_S = 1e-9
"""Times of a path that are nearer to each other are one."""


def joined(motion: Motion, from_s: float, trajectory: Trajectory, speed_m_s: float) -> Trajectory:
    """What is left of a motion's path until `from_s`, and a trajectory from there on; time 0 is the motion's progress.

    Raises:
        TrajectoryError: more knots than a trajectory may have, or it lasts too long.
    """
    path, since_s = motion.path, motion.progress_s
    from_s = min(from_s, path.duration_s)
    left = (path.times_s >= since_s + _SAME_S) & (path.times_s <= from_s - _SAME_S)
    times, lengths = path.times_s[left] - since_s, path.lengths_m[left]
    at_m, at_s = path.at(from_s), from_s - since_s
    if at_s >= _SAME_S:
        times, lengths = np.append(times, at_s), np.vstack((lengths, at_m))
    after = paced(at_m, trajectory, speed_m_s)
    return Trajectory(np.concatenate((times, at_s + after.times_s)), np.concatenate((lengths, after.lengths_m)))


def paced(at_m: Sequence[float] | NDArray[np.float64], trajectory: Trajectory, speed_m_s: float) -> Trajectory:
    """A trajectory from lengths (6,) that whoever asked for it did not know.

    Its times are the least: a stretch that is longer from there takes as long as `speed_m_s` lets it.
    """
    ways_m = np.abs(np.diff(trajectory.lengths_m, axis=0, prepend=np.asarray(at_m)[None])).max(axis=1)
    spans_s = np.diff(trajectory.times_s, prepend=0.0)
    return Trajectory(np.cumsum(np.maximum(np.maximum(spans_s, ways_m / speed_m_s), CLOSEST_S)), trajectory.lengths_m)
