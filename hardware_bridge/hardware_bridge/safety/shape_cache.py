# SPDX-License-Identifier: Apache-2.0
"""Verdicts on shapes, made before a command is judged and only looked up while it is: the frame loop never waits for a solver."""

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.errors import SEND_AGAIN
from sim_core.names import STRUT_NAMES

Verdict = str | tuple[float, ...] | None
"""What is wrong with a shape; or the axial forces of its struts, six, in [N]; or None: nothing is wrong, and no force is known."""

ShapeCheck = Callable[[tuple[float, ...]], Verdict]
"""Takes six rest lengths [m]."""

Loads = tuple[bool, ...]
"""Whether each strut is held against more than its back-drive force."""

NO_LOADS: Loads = (False,) * len(STRUT_NAMES)
ALL_LOADS: Loads = (True,) * len(STRUT_NAMES)

MOST_SHAPES = 40000
"""More than twice what the longest path may have, see `limit_checks.MOST_SHAPES`: it fits beside what was judged before it."""

NOT_JUDGED = f"nobody has judged it, the struts were elsewhere when the command was looked at; {SEND_AGAIN}"


class ShapeMemory:
    """Remembers what a slow judge said. May be used from any thread.

    Args:
        judge: the slow one; called by one thread at a time, with nothing of ours locked but this.
        near_m: how far, strut by strut, a frame may be from a permitted shape to count as that shape, in [m].
        back_drive_n: the axial force that a strut holds without power, in [N].
    """

    def __init__(self, judge: ShapeCheck, near_m: float, back_drive_n: float = math.inf) -> None:
        self._judge = judge
        self._near_m = near_m
        self._back_drive_n = back_drive_n
        self._problems: OrderedDict[tuple[float, ...], str | None] = OrderedDict()
        # a row each; NaN: not permitted, so never near
        self._shapes = np.full((MOST_SHAPES, len(STRUT_NAMES)), np.nan)
        self._loads = np.ones((MOST_SHAPES, len(STRUT_NAMES)), dtype=bool)
        self._rows: dict[tuple[float, ...], int] = {}
        self._knows_forces = False
        self._lock = threading.Lock()
        self._judging = threading.Lock()

    def judge(self, lengths_m: Sequence[float]) -> str | None:
        """What is wrong, asking the judge if it is a new shape. Not under the bridge's lock."""
        key = _key(lengths_m)
        with self._judging:
            with self._lock:
                if key in self._problems:
                    self._problems.move_to_end(key)
                    return self._problems[key]
            verdict = self._judge(key)
            problem = verdict if isinstance(verdict, str) else None
            with self._lock:
                row = len(self._problems)
                if row == MOST_SHAPES:
                    row = self._rows.pop(self._problems.popitem(last=False)[0])
                self._problems[key], self._rows[key] = problem, row
                self._shapes[row] = np.nan if problem is not None else key
                self._loads[row] = True
                if isinstance(verdict, tuple):
                    self._knows_forces = True
                    self._loads[row] = np.abs(verdict) > self._back_drive_n
            return problem

    def recall(self, lengths_m: Sequence[float]) -> str | None:
        """What is wrong, or None if a permitted shape is near; what nobody has judged is not permitted."""
        key = _key(lengths_m)
        with self._lock:
            if key in self._problems:
                return self._problems[key]
            return None if self._near(key).any() else NOT_JUDGED

    def loads(self, lengths_m: Sequence[float]) -> Loads:
        """Which struts are loaded in this shape, or in any permitted one that is near.

        In a shape that nobody has judged, or that is not permitted, all are: too much is counted rather than too little. Of a judge
        that has never told a force, none.
        """
        key = _key(lengths_m)
        with self._lock:
            if not self._knows_forces:
                return NO_LOADS
            if key in self._rows:
                return tuple(self._loads[self._rows[key]].tolist())
            near = self._near(key)
            return tuple(np.asarray(self._loads[: len(near)][near].any(axis=0)).tolist()) if near.any() else ALL_LOADS

    def _near(self, key: tuple[float, ...]) -> NDArray[np.bool_]:
        """Which rows are permitted shapes near one."""
        return np.asarray((np.abs(self._shapes[: len(self._problems)] - key) <= self._near_m).all(axis=1))


def _key(lengths_m: Sequence[float]) -> tuple[float, ...]:
    """Whole tenths of a micrometre, so that one shape has one key however it was computed."""
    return tuple(round(float(length), 7) for length in lengths_m)
