"""The few operations that the kernels' formulas use beside + − × ÷.

The kernels are written branch-free per robot on these, on flat rows of numbers, so that the same source can be compiled for
one robot
(a row is a float64) or for robots side by side in the lanes of the vector unit (a row is a vector). No fast-math, no trigonometry:
one robot gives the same bits however it is run.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def select(condition, yes, no):
    """`yes` where the condition holds, else `no`; both are evaluated."""
    return yes if condition else no


@njit(cache=True)
def root(value):
    """Correctly rounded square root."""
    return math.sqrt(value)


@njit(cache=True)
def larger(a, b):
    return a if a > b else b


@njit(cache=True)
def smaller(a, b):
    return a if a < b else b


@njit(cache=True)
def any_of(condition):
    """True if the condition holds for any robot in the row."""
    return condition
