# SPDX-License-Identifier: Apache-2.0
"""The kernel's work, counted: what a step computes does not depend on the computer or on what else it does.

The kernel's own source runs as plain Python on numbers that count their operations, so that no second copy of a formula is
counted; its result has the same bits as the compiled step.
"""

from __future__ import annotations

from collections import Counter
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit, typeof, types

from sim_core.dynamics import simd, vfife
from sim_core.dynamics.model import Model
from sim_core.structure.arrays import Array

ARITHMETIC = ("add", "multiply", "divide", "root")
MEMORY = ("load", "store")


class _Number:
    """A float64 that counts what is done with it."""

    __slots__ = ("tally", "value")

    def __init__(self, value: float, tally: Counter[str]):
        self.value, self.tally = value, tally

    def _of(self, kind: str, value: float) -> _Number:
        self.tally[kind] += 1
        return _Number(value, self.tally)

    def __add__(self, other: Any) -> _Number:
        return self._of("add", self.value + _value(other))

    def __sub__(self, other: Any) -> _Number:
        return self._of("add", self.value - _value(other))

    def __rsub__(self, other: Any) -> _Number:
        return self._of("add", _value(other) - self.value)

    def __mul__(self, other: Any) -> _Number:
        return self._of("multiply", self.value * _value(other))

    def __truediv__(self, other: Any) -> _Number:
        return self._of("divide", self.value / _value(other))

    def __rtruediv__(self, other: Any) -> _Number:
        return self._of("divide", _value(other) / self.value)

    def __neg__(self) -> _Number:
        return self._of("negate", -self.value)

    def __lt__(self, other: Any) -> bool:
        return self._compare(self.value < _value(other))

    def __le__(self, other: Any) -> bool:
        return self._compare(self.value <= _value(other))

    def __gt__(self, other: Any) -> bool:
        return self._compare(self.value > _value(other))

    def __ge__(self, other: Any) -> bool:
        return self._compare(self.value >= _value(other))

    def _compare(self, answer: bool) -> bool:
        self.tally["compare"] += 1
        return answer

    __radd__, __rmul__ = __add__, __mul__


def _value(number: Any) -> float:
    return float(number.value if isinstance(number, _Number) else number)


def _counting(tally: Counter[str]) -> dict[str, Any]:
    """The kernel's module with every compiled function as plain Python, on counting numbers."""

    def load(array: Array, row: int) -> _Number:
        tally["load"] += 1
        return _Number(float(array[row]), tally)

    def store(array: Array, row: int, value: Any) -> None:
        tally["store"] += 1
        array[row] = _value(value)

    def select(condition: bool, yes: Any, no: Any) -> _Number:
        tally["select"] += 1
        return _Number(_value(yes if condition else no), tally)

    def root(number: _Number) -> _Number:
        tally["root"] += 1
        return _Number(float(np.sqrt(number.value)), tally)

    def any_of(condition: bool) -> bool:
        return condition

    names: dict[str, Any] = dict(vars(vfife))
    names |= {"load": load, "store": store, "select": select, "root": root, "any_of": any_of}
    for module in (simd, vfife):
        for name, value in vars(module).items():
            if hasattr(value, "py_func") and name in names:
                plain = value.py_func
                names[name] = FunctionType(plain.__code__, names, name, plain.__defaults__)
    return names


def count_step(model: Model, state: Array, work: Array) -> Counter[str]:
    """Operations of one step of one robot, by kind. Changes `state` and `work` as the compiled step does."""
    tally: Counter[str] = Counter()
    m = model
    _counting(tally)["advance"](state, m.par, work, m.assembly, m.dt_s, m.elements.zeta_1_s, m.reach_m, 1)
    return tally


def compiled_operations(model: Model) -> dict[str, Counter[str]]:
    """Floating-point operations in the compiled code of a step for eight robots, by kind: "packed" ones do eight robots at once,
    "single" ones do one number. A static count of the compiler's intermediate code, the same on every x86-64 processor with or
    without wide registers."""
    rows = types.Array(types.float64, 2, "C")
    numbers = types.float64, types.float64, types.float64, types.int64
    step = njit(vfife.advance.py_func)  # compiled here: code from numba's cache has no intermediate form left
    step.compile((rows, rows, rows, typeof(model.assembly), *numbers))
    found: dict[str, Counter[str]] = {"packed": Counter(), "single": Counter()}
    for line in step.inspect_llvm(step.signatures[0]).splitlines():
        for kind in ("fadd", "fsub", "fmul", "fdiv", "llvm.sqrt"):
            if f" {kind} " in line or (f"@{kind}." in line and " call " in line):
                width = "packed" if f"<{simd.WIDTH} x double>" in line else "single"
                found[width][kind] += 1
    return found
