# SPDX-License-Identifier: Apache-2.0
"""From present lengths to others, every strut at the actuators' speed, as knots of a trajectory. Knows no ROS."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

SAME_TIME_S = 1e-3
"""Struts that stop closer together than this share a knot."""


class Knot(NamedTuple):
    """Rest lengths (m, S1..S6) at a time (s) since the start."""

    time_s: float
    lengths_m: tuple[float, ...]


def constant_speed_knots(start_m: Sequence[float], *stops_m: Sequence[float], speed_m_s: float) -> tuple[Knot, ...]:
    """All struts start together and drive at `speed_m_s`; each stops at its own time, and that is a knot.

    So there are at most six knots to each stop, and none if every strut is there already; when all are, they go on to the next.
    Between knots each strut moves at constant speed: the straight lines that join the knots are the motion itself.
    """
    knots: list[Knot] = []
    for begin_m, end_m in pairwise((start_m, *stops_m)):
        since_s = knots[-1].time_s if knots else 0.0
        knots += [Knot(since_s + knot.time_s, knot.lengths_m) for knot in _to_one(begin_m, end_m, speed_m_s)]
    return tuple(knots)


def _to_one(start_m: Sequence[float], target_m: Sequence[float], speed_m_s: float) -> tuple[Knot, ...]:
    ways_m = [abs(target - start) for start, target in zip(start_m, target_m, strict=True)]
    ends_s: list[float] = []
    for end_s in sorted(way / speed_m_s for way in ways_m if way > 0.0):
        if ends_s and end_s - ends_s[-1] < SAME_TIME_S:
            ends_s[-1] = end_s
        else:
            ends_s.append(end_s)
    return tuple(Knot(end_s, _at(start_m, target_m, speed_m_s * end_s)) for end_s in ends_s)


def _at(start_m: Sequence[float], target_m: Sequence[float], way_m: float) -> tuple[float, ...]:
    return tuple(
        target if abs(target - start) <= way_m else start + (way_m if target > start else -way_m)
        for start, target in zip(start_m, target_m, strict=True)
    )
