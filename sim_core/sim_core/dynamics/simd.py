# SPDX-License-Identifier: Apache-2.0
"""Numbers for the kernels: one robot's float64, or eight robots' side by side in the lanes of the vector unit.

The kernels' formulas are written once, on the operations below and + − × ÷, on *rows*: a row of a 1-D array is one robot's
number, a row of an (n, 8) array is a vector of eight robots' numbers. numba compiles the same source for either. Every operation
is IEEE-exact and works lane by lane (no fast-math, no trigonometry, no contraction), so a robot gets the same bits in any lane,
next to any neighbours, or alone.

Plain loops over a lane axis do not vectorise (the compiler cannot rule out aliasing), hence an explicit vector type.
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from sim_core.dynamics.jit_cache import njit

WIDTH = 8
"""Robots in a vector: eight float64 are one cache line, and one AVX-512 register."""
ALIGNMENT = 64
"""Bytes to which every row of an (n, WIDTH) array must be aligned; see `aligned_rows`."""

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)


class LanesType(types.Type):
    """numba's type of eight float64."""

    def __init__(self) -> None:
        super().__init__(name="float64x8")


class MaskType(types.Type):
    """numba's type of eight truth values."""

    def __init__(self) -> None:
        super().__init__(name="boolean8")


lanes, mask = LanesType(), MaskType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any):
        super().__init__(manager, fe_type, _VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any):
        super().__init__(manager, fe_type, _BITS)


def _widened(context: Any, builder: Any, value: Any, kind: Any) -> Any:
    """A vector of this value: itself, or a scalar in every lane."""
    if isinstance(kind, LanesType):
        return value
    scalar = context.cast(builder, value, kind, types.float64)
    none = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(none, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


def _define(function: Any, result: Any, emit: Any) -> None:
    """Teach numba an operator on vectors, and on a vector and a scalar."""
    pairs = ((lanes, lanes), (lanes, types.float64), (types.float64, lanes))
    template = type(f"Lanes_{function.__name__}", (ConcreteTemplate,), {"cases": [signature(result, a, b) for a, b in pairs]})
    infer_global(function)(template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *(_widened(context, builder, value, kind) for value, kind in zip(args, sig.args, strict=True)))

    for a, b in pairs:
        lower_builtin(function, a, b)(lower)


for _function, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define(_function, lanes, lambda builder, a, b, name=_name: getattr(builder, name)(a, b))
for _function, _code in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _define(_function, mask, lambda builder, a, b, code=_code: builder.fcmp_ordered(code, a, b))


@infer_global(operator.neg)
class _Negative(ConcreteTemplate):
    cases = [signature(lanes, lanes)]  # noqa: RUF012 (numba's way)


@lower_builtin(operator.neg, lanes)
def _lower_negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])


def _address(context: Any, builder: Any, kind: Any, array: Any, row: Any) -> Any:
    """Pointer to a row; no bounds check, no wrap-around of negative rows."""
    data = context.make_array(kind)(context, builder, array).data
    if kind.ndim == 1:
        return builder.gep(data, [row])
    start = builder.gep(data, [builder.mul(row, ir.Constant(row.type, WIDTH))])
    return builder.bitcast(start, _VECTOR.as_pointer())


@intrinsic
def load(typing_context: Any, array: Any, row: Any) -> Any:
    """The row of a contiguous array: a float64 of a 1-D array, a vector of an (n, WIDTH) array."""
    result = array.dtype if array.ndim == 1 else lanes

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(_address(context, builder, sig.args[0], args[0], args[1]))
        if sig.args[0].ndim > 1:
            value.align = ALIGNMENT
        return value

    return result(array, types.intp), lower


@intrinsic
def store(typing_context: Any, array: Any, row: Any, value: Any) -> Any:
    """Set the row of a contiguous array; a scalar goes into every lane."""
    given = types.float64 if array.ndim == 1 else value

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        new = args[2] if sig.args[0].ndim == 1 else _widened(context, builder, args[2], sig.args[2])
        written = builder.store(new, _address(context, builder, sig.args[0], args[0], args[1]))
        if sig.args[0].ndim > 1:
            written.align = ALIGNMENT
        return context.get_dummy_value()

    return types.void(array, types.intp, given), lower


@intrinsic
def select(typing_context: Any, condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, else `no`; both are evaluated."""
    if isinstance(condition, MaskType):

        def lower_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            both = (_widened(context, builder, args[i], sig.args[i]) for i in (1, 2))
            return builder.select(args[0], *both)

        return lanes(condition, yes, no), lower_lanes

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return types.float64(types.boolean, types.float64, types.float64), lower


@intrinsic
def root(typing_context: Any, value: Any) -> Any:
    """Correctly rounded square root."""
    kind = lanes if isinstance(value, LanesType) else types.float64

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = "llvm.sqrt.v8f64" if isinstance(kind, LanesType) else "llvm.sqrt.f64"
        shape = ir.FunctionType(args[0].type, [args[0].type])
        return builder.call(cgutils.get_or_insert_function(builder.module, shape, name), args)

    return kind(kind), lower


@intrinsic
def any_of(typing_context: Any, condition: Any) -> Any:
    """True if the condition holds for any robot of the row."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(sig.args[0], MaskType):
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(condition if isinstance(condition, MaskType) else types.boolean), lower


@njit(cache=True)
def larger(a, b):
    """The larger of two numbers, lane by lane."""
    return select(a > b, a, b)


@njit(cache=True)
def smaller(a, b):
    """The smaller of two numbers, lane by lane."""
    return select(a < b, a, b)


@njit(cache=True)
def add_to(array, row, value):
    """Add to a row."""
    store(array, row, load(array, row) + value)
