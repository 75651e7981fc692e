"""Vectors of the processor's own width inside numba kernels.

LLVM's loop vectoriser has to prove, or to check at run time in front of every loop, that the arrays of a loop don't
overlap; on rows of some hundred elements those checks and the reference counts of array slices cost more than the
arithmetic (measured: a factor 4 to 8). These intrinsics state the vectors themselves: ``load`` and ``store`` take an
array and an offset in elements from its first one, without any bounds check, so a kernel addresses rows by offsets
and never slices. A machine with narrower registers runs the same code in several instructions a vector.

``load(a, i)``, ``store(a, i, v)``; ``load_some``, ``store_some`` for the first ``count`` elements only (the others read as 0);
``splat``, ``add``, ``sub``, ``mul``, ``fma``, ``lowest``, ``highest``, ``magnitude``, ``total``; ``evens``, ``odds`` (split two vectors
into their elements of even and odd place) and their inverses ``zip_low``, ``zip_high``.
"""

from typing import Any

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic
from numba.extending import models, register_model

intrinsic: Any = _intrinsic  # numba types it by the signature that only the compiler sees
BYTES = 64 if llvmlite.binding.get_host_cpu_features().get("avx512f") else 32


def lanes(dtype: Any) -> int:
    """Count the elements of a vector."""
    return BYTES // np.dtype(dtype).itemsize


class Vector(types.Type):
    """numba's type of a vector of floating-point numbers."""

    def __init__(self, dtype: types.Float) -> None:
        self.dtype = dtype
        self.count = BYTES * 8 // dtype.bitwidth
        super().__init__(name=f"Vector({dtype}, {self.count})")


@register_model(Vector)
class VectorModel(models.PrimitiveModel):
    """A vector is one LLVM value."""

    def __init__(self, manager: Any, kind: Vector) -> None:
        super().__init__(manager, kind, ir.VectorType(_scalar(kind.dtype), kind.count))


def _scalar(dtype: types.Float) -> ir.Type:
    return ir.FloatType() if dtype.bitwidth == 32 else ir.DoubleType()


def _suffix(kind: Vector) -> str:
    return f"v{kind.count}f{kind.dtype.bitwidth}"


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Vector) -> Any:
    """Return the address of an array's element, seen as that of a vector."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), context.get_value_type(vector).as_pointer())


def _mask(builder: Any, vector: Vector, count: Any) -> Any:
    """Return which elements are among the first ``count``."""
    whole = ir.VectorType(ir.IntType(64), vector.count)
    places = ir.Constant(whole, list(range(vector.count)))
    return builder.icmp_signed("<", places, _spread(builder, count, whole))


def _spread(builder: Any, value: Any, kind: ir.VectorType) -> Any:
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), kind.count), None))


def _call(builder: Any, name: str, result: ir.Type, *arguments: Any) -> Any:
    kind = ir.FunctionType(result, [a.type for a in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


@intrinsic
def load(context, array, index):  # type: ignore[no-untyped-def]
    """Return the vector that begins at an element."""
    vector = Vector(array.dtype)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        return builder.load(at, align=array.dtype.bitwidth // 8)

    return vector(array, types.intp), generate


@intrinsic
def load_some(context, array, index, count):  # type: ignore[no-untyped-def]
    """Return the vector that begins at an element, with 0 in the places from ``count`` on, which are not read."""
    vector = Vector(array.dtype)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        kind = context.get_value_type(vector)
        align = ir.Constant(ir.IntType(32), array.dtype.bitwidth // 8)
        nothing = ir.Constant(kind, None)
        return _call(builder, f"llvm.masked.load.{_suffix(vector)}.p0", kind, at, align, _mask(builder, vector, arguments[2]), nothing)

    return vector(array, types.intp, types.intp), generate


@intrinsic
def store(context, array, index, value):  # type: ignore[no-untyped-def]
    """Write a vector to the places from an element on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], signature.args[2])
        builder.store(arguments[2], at, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


@intrinsic
def store_some(context, array, index, value, count):  # type: ignore[no-untyped-def]
    """Write the first ``count`` elements of a vector."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = signature.args[2]
        at = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        align = ir.Constant(ir.IntType(32), array.dtype.bitwidth // 8)
        mask = _mask(builder, vector, arguments[3])
        _call(builder, f"llvm.masked.store.{_suffix(vector)}.p0", ir.VoidType(), arguments[2], at, align, mask)
        return context.get_dummy_value()

    return types.void(array, types.intp, value, types.intp), generate


@intrinsic
def splat(context, number):  # type: ignore[no-untyped-def]
    """Return a vector of one number everywhere."""
    vector = Vector(number)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0], context.get_value_type(vector))

    return vector(number), generate


def _arithmetic(operation: str) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, operation)(*arguments)

    return generate


def _chosen(order: str) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(builder.fcmp_ordered(order, *arguments), *arguments)

    return generate


def _function(name: str) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, f"llvm.{name}.{_suffix(signature.return_type)}", arguments[0].type, *arguments)

    return generate


@intrinsic
def add(context, a, b):  # type: ignore[no-untyped-def]
    """Return a + b."""
    return a(a, b), _arithmetic("fadd")


@intrinsic
def sub(context, a, b):  # type: ignore[no-untyped-def]
    """Return a - b."""
    return a(a, b), _arithmetic("fsub")


@intrinsic
def mul(context, a, b):  # type: ignore[no-untyped-def]
    """Return a b."""
    return a(a, b), _arithmetic("fmul")


@intrinsic
def fma(context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a b + c, rounded once where the processor can."""
    return a(a, b, c), _function("fmuladd")


@intrinsic
def lowest(context, a, b):  # type: ignore[no-untyped-def]
    """Return the lesser of each pair; b where one is not a number."""
    return a(a, b), _chosen("<")


@intrinsic
def highest(context, a, b):  # type: ignore[no-untyped-def]
    """Return the greater of each pair; b where one is not a number."""
    return a(a, b), _chosen(">")


@intrinsic
def magnitude(context, a):  # type: ignore[no-untyped-def]
    """Return the absolute values."""
    return a(a), _function("fabs")


@intrinsic
def total(context, a):  # type: ignore[no-untyped-def]
    """Return the sum of the elements, always added in the same order (halves to halves)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value, count = arguments[0], a.count
        while count > 1:
            count //= 2
            half = ir.VectorType(ir.IntType(32), count)
            low = builder.shuffle_vector(value, value, ir.Constant(half, list(range(count))))
            high = builder.shuffle_vector(value, value, ir.Constant(half, list(range(count, 2 * count))))
            value = builder.fadd(low, high)
        return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))

    return a.dtype(a), generate


def _shuffle(places: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        chosen = places(signature.return_type.count)
        return builder.shuffle_vector(*arguments, ir.Constant(ir.VectorType(ir.IntType(32), len(chosen)), chosen))

    return generate


@intrinsic
def evens(context, a, b):  # type: ignore[no-untyped-def]
    """Return the elements 0, 2, 4, ... of a followed by b."""
    return a(a, b), _shuffle(lambda n: list(range(0, 2 * n, 2)))


@intrinsic
def odds(context, a, b):  # type: ignore[no-untyped-def]
    """Return the elements 1, 3, 5, ... of a followed by b."""
    return a(a, b), _shuffle(lambda n: list(range(1, 2 * n, 2)))


@intrinsic
def zip_low(context, a, b):  # type: ignore[no-untyped-def]
    """Return a[0], b[0], a[1], b[1], ... of the first halves."""
    return a(a, b), _shuffle(lambda n: [i // 2 + n * (i % 2) for i in range(n)])


@intrinsic
def zip_high(context, a, b):  # type: ignore[no-untyped-def]
    """Return a, b, a, b, ... of the second halves."""
    return a(a, b), _shuffle(lambda n: [n // 2 + i // 2 + n * (i % 2) for i in range(n)])
