# SPDX-License-Identifier: Apache-2.0
"""Verdicts on shapes, made before a command is judged and only looked up while it is: the frame loop never waits for a solver."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence

import numpy as np

from hardware_bridge.errors import SEND_AGAIN

ShapeCheck = Callable[[tuple[float, ...]], str | None]
"""Takes six rest lengths [m]; returns what is wrong with the shape, or None."""

MOST_SHAPES = 40000
"""More than twice what the longest path may have, see `limit_checks.MOST_SHAPES`: it fits beside what was judged before it."""

NOT_JUDGED = f"nobody has judged it, the struts were elsewhere when the command was looked at; {SEND_AGAIN}"


class ShapeMemory:
    """Remembers what a slow judge said. May be used from any thread.

    Args:
        judge: the slow one; called by one thread at a time, with nothing of ours locked but this.
        near_m: how far, strut by strut, a frame may be from a permitted shape to count as that shape, in [m].
    """

    def __init__(self, judge: ShapeCheck, near_m: float) -> None:
        self._judge = judge
        self._near_m = near_m
        self._verdicts: OrderedDict[tuple[float, ...], str | None] = OrderedDict()
        self._permitted: np.ndarray | None = None
        self._lock = threading.Lock()
        self._judging = threading.Lock()

    def judge(self, lengths_m: Sequence[float]) -> str | None:
        """The verdict, asking the judge if it is a new shape. Not under the bridge's lock."""
        key = _key(lengths_m)
        with self._judging:
            with self._lock:
                if key in self._verdicts:
                    self._verdicts.move_to_end(key)
                    return self._verdicts[key]
            verdict = self._judge(key)
            with self._lock:
                self._verdicts[key] = verdict
                while len(self._verdicts) > MOST_SHAPES:
                    self._verdicts.popitem(last=False)
                self._permitted = None
            return verdict

    def recall(self, lengths_m: Sequence[float]) -> str | None:
        """The verdict on this shape, or None if a permitted one is near; what nobody has judged is not permitted."""
        key = _key(lengths_m)
        with self._lock:
            if key in self._verdicts:
                return self._verdicts[key]
            if self._permitted is None:
                good = [shape for shape, problem in self._verdicts.items() if problem is None]
                self._permitted = np.array(good).reshape(-1, len(key))
            near = np.abs(self._permitted - np.array(key)).max(axis=1, initial=0.0) <= self._near_m
            return None if near.any() else NOT_JUDGED


def _key(lengths_m: Sequence[float]) -> tuple[float, ...]:
    """Whole tenths of a micrometre, so that one shape has one key however it was computed."""
    return tuple(round(float(length), 7) for length in lengths_m)
