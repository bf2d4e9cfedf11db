"""Vectors of sixteen float32 for numba kernels whose loops the compiler does not vectorise.

A `Lanes` value is one vector register with AVX-512, two with AVX2 and four with NEON or SSE. LLVM
splits it, so one kernel serves all. Arrays are flat. Indices are not checked: they must lie inside
the array, and negative ones do not count from the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numba.extending
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import models, overload, register_model

LANES = 16

_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_FLOATS, _INTS = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES)
# Allows fused and reordered sums of products, as `fastmath` does for scalars.
_FAST = ("fast",)
# 2**f = sum_k c_k f**k for |f| <= 1/2, relative error below 2e-7.
_EXP2 = (1.3390903e-3, 9.6760335e-3, 5.5503577e-2, 2.4022107e-1, 6.9314719e-1, 1.0)


def intrinsic(generator: Callable[..., Any]) -> Callable[..., Any]:
    """Numba intrinsic with the signature that kernels call: without the generator's `_typing`."""
    return numba.extending.intrinsic(generator)


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"float32x{LANES}")


lanes = _LanesType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes_type) -> None:
        super().__init__(manager, lanes_type, _FLOATS)


def _constant(value: float) -> ir.Constant:
    return ir.Constant(_FLOATS, [float(np.float32(value))] * LANES)


def _llvm(builder, name: str, returned, *taken):
    """LLVM intrinsic on a vector."""
    signature = ir.FunctionType(returned, taken)
    return cgutils.get_or_insert_function(builder.module, signature, f"llvm.{name}.v{LANES}f32")


def _spread(builder, scalar):
    first = ir.Constant(_INT, 0)
    one = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), scalar, first)
    return builder.shuffle_vector(one, one, ir.Constant(_INTS, [0] * LANES))


def _pointer(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index])


@intrinsic
def ramp(_typing):
    """Lanes 0, 1, ... 15."""

    def generate(_context, _builder, _signature, _arguments):
        return ir.Constant(_FLOATS, [float(i) for i in range(LANES)])

    return lanes(), generate


@intrinsic
def fill(_typing, value):
    """One float32 in all lanes."""

    def generate(_context, builder, _signature, arguments):
        return _spread(builder, arguments[0])

    return lanes(types.float32), generate


@intrinsic
def fill_from(_typing, array, index):
    """array[index] in all lanes."""

    def generate(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return _spread(builder, builder.load(pointer))

    return lanes(array, types.intp), generate


@intrinsic
def load(_typing, array, index):
    """array[index : index + 16]."""

    def generate(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.load(builder.bitcast(pointer, _FLOATS.as_pointer()), align=4)

    return lanes(array, types.intp), generate


@intrinsic
def store(_typing, array, index, values):
    """Write lanes: array[index : index + 16] = values."""

    def generate(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], builder.bitcast(pointer, _FLOATS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, values), generate


@intrinsic
def exp2_above(_typing, exponent, least):
    """2**exponent where exponent >= least, else 0; least: float32 from -126, exponent <= 126."""

    def generate(_context, builder, _signature, arguments):
        e, least = arguments
        counts = builder.fcmp_ordered(">=", e, _spread(builder, least))
        whole = builder.call(_llvm(builder, "roundeven", _FLOATS, _FLOATS), [e])
        f = builder.fsub(e, whole, flags=_FAST)
        power = _constant(_EXP2[0])
        for c in _EXP2[1:]:
            power = builder.fadd(builder.fmul(power, f, flags=_FAST), _constant(c), flags=_FAST)
        shift = builder.shl(builder.fptosi(whole, _INTS), ir.Constant(_INTS, [23] * LANES))
        scaled = builder.bitcast(builder.add(builder.bitcast(power, _INTS), shift), _FLOATS)
        return builder.select(counts, scaled, _constant(0.0))

    return lanes(lanes, types.float32), generate


@intrinsic
def at_most(_typing, x, y):
    """Bit mask: bit i is set if x <= y in lane i."""

    def generate(_context, builder, _signature, arguments):
        bits = builder.bitcast(builder.fcmp_ordered("<=", *arguments), ir.IntType(LANES))
        return builder.zext(bits, _INT)

    return types.uint32(lanes, lanes), generate


@intrinsic
def larger(_typing, x, y):
    """Larger of two values, lane by lane."""

    def generate(_context, builder, _signature, arguments):
        return builder.select(builder.fcmp_ordered(">", *arguments), *arguments)

    return lanes(lanes, lanes), generate


def _reduction(name: str, *start: float):
    @intrinsic
    def reduce(_typing, values):
        def generate(_context, builder, _signature, arguments):
            first = [ir.Constant(_FLOAT, value) for value in start]
            function = _llvm(
                builder, f"vector.reduce.{name}", _FLOAT, *[_FLOAT] * len(first), _FLOATS
            )
            return builder.call(function, [*first, *arguments], fastmath=_FAST)

        return types.float32(lanes), generate

    return reduce


sum_of = _reduction("fadd", -0.0)
largest_of = _reduction("fmax")


def _arithmetic(operation, instruction: str) -> None:
    @intrinsic
    def work(_typing, x, y):
        def generate(_context, builder, _signature, arguments):
            return getattr(builder, instruction)(*arguments, flags=_FAST)

        return lanes(lanes, lanes), generate

    @overload(operation)
    def implementation(x, y):
        if x == lanes and y == lanes:
            return lambda x, y: work(x, y)
        return None


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")
