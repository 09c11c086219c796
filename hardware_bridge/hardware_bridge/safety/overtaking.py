# SPDX-License-Identifier: Apache-2.0
"""A motion that follows another without a stop between."""

import numpy as np

from hardware_bridge.safety.supervisor_messages import Motion
from hardware_bridge.safety.trajectory import CLOSEST_S, Trajectory


def joined(motion: Motion, from_s: float, trajectory: Trajectory, speed_m_s: float) -> Trajectory:
    """What is left of a motion's path until `from_s`, and a trajectory from there on; time 0 is the motion's progress.

    Whoever asks does not know where the struts will be then. So the trajectory's times are the least: a stretch that is longer from
    there takes as long as `speed_m_s` lets it.

    Raises:
        TrajectoryError: more knots than a trajectory may have, or it lasts too long.
    """
    path, since_s = motion.path, motion.progress_s
    from_s = min(from_s, path.duration_s)
    left = (path.times_s > since_s) & (path.times_s < from_s)
    times, lengths = list(path.times_s[left] - since_s), list(path.lengths_m[left])
    at_m, time_s, before_s = path.at(from_s), from_s - since_s, 0.0
    if time_s > 0.0:
        times.append(time_s)
        lengths.append(at_m)
    for knot_s, knot_m in zip(trajectory.times_s, trajectory.lengths_m, strict=True):
        least_s = float(np.abs(knot_m - at_m).max()) / speed_m_s
        time_s += max(float(knot_s) - before_s, least_s, CLOSEST_S)
        before_s, at_m = float(knot_s), knot_m
        times.append(time_s)
        lengths.append(knot_m)
    return Trajectory(np.array(times), np.array(lengths))
