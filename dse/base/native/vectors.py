"""Vectors as values in Numba code: kernels that state their registers instead of hoping for them.

LLVM's loop vectoriser keeps running sums in memory, stays at 256 bits and builds bit masks byte by byte;
that costs the kernels of the engine a factor of two to four. Here `load(array, offset, LANES_64)` is a value
of 64 lanes that takes `+`, `-`, `*` and `/` like a number, and LLVM maps it to whatever registers the machine
has. Nothing is reassociated or contracted, so that every lane is plain IEEE arithmetic: a result depends
neither on the machine nor on the lane a neuron sits in.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel import models
from numba.core.imputils import lower_constant
from numba.core.typing.typeof import typeof_impl
from numba.extending import intrinsic, overload, register_model


def _intrinsic(function: Callable[..., Any]) -> Any:
    """Make a function that writes LLVM code callable from Numba code; type checkers see neither side."""
    return intrinsic(function)


_ELEMENTS = {
    types.boolean: ir.IntType(1),
    types.int8: ir.IntType(8),
    types.int16: ir.IntType(16),
    types.int32: ir.IntType(32),
    types.int64: ir.IntType(64),
    types.uint64: ir.IntType(64),
    types.float32: ir.FloatType(),
    types.float64: ir.DoubleType(),
}


class Vector(types.Type):
    """The Numba type of `lanes` values of one element type."""

    def __init__(self, element: Any, lanes: int) -> None:
        self.element = element
        self.lanes = lanes
        self.llvm = ir.VectorType(_ELEMENTS[element], lanes)
        super().__init__(name=f"{element}x{lanes}")

    @property
    def is_float(self) -> bool:
        return isinstance(self.element, types.Float)

    @property
    def n_bytes(self) -> int:
        return int(self.element.bitwidth // 8)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(manager, vector, vector.llvm)


@dataclass(frozen=True)
class Lanes:
    """A number of lanes that is known when the code is compiled."""

    n: int


class _LanesType(types.Dummy):
    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(name=f"lanes({n})")


register_model(_LanesType)(models.OpaqueModel)
LANES_2, LANES_4, LANES_8 = Lanes(2), Lanes(4), Lanes(8)
LANES_16, LANES_32, LANES_64 = Lanes(16), Lanes(32), Lanes(64)


@typeof_impl.register(Lanes)
def _type_of_lanes(value: Lanes, context: Any) -> Any:
    return _LanesType(value.n)


@lower_constant(_LanesType)
def _constant_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


def _place(context: Any, builder: Any, kind: Any, array: Any, offset: Any, vector: Vector) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), vector.llvm.as_pointer())


@_intrinsic
def load(typing_context: Any, array: Any, offset: Any, lanes: Any) -> Any:
    """Return consecutive elements of a contiguous array, from `offset` on; nothing checks its end."""
    vector = Vector(array.dtype, lanes.n)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        loaded = builder.load(_place(context, builder, array, values[0], values[1], vector))
        loaded.align = vector.n_bytes
        return loaded

    return vector(array, types.intp, lanes), generate


@_intrinsic
def store(typing_context: Any, array: Any, offset: Any, value: Any) -> Any:
    """Write a vector to a contiguous array from `offset` on; its lanes become the array's element type."""
    vector = Vector(array.dtype, value.lanes)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        target = _place(context, builder, array, values[0], values[1], vector)
        builder.store(_cast(builder, value, vector, values[2]), target).align = vector.n_bytes
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


@_intrinsic
def splat(typing_context: Any, x: Any, like: Any) -> Any:
    """Return the number x in every lane of a vector of the same type as `like`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = context.cast(builder, values[0], x, like.element)
        undefined = ir.Constant(like.llvm, ir.Undefined)
        first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
        order = ir.Constant(ir.VectorType(ir.IntType(32), like.lanes), [0] * like.lanes)
        return builder.shuffle_vector(first, undefined, order)

    return like(x, like), generate


@_intrinsic
def zeros(typing_context: Any, array: Any, lanes: Any) -> Any:
    """Return a vector of zeros of an array's element type."""
    vector = Vector(array.dtype, lanes.n)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return ir.Constant(vector.llvm, None)

    return vector(array, lanes), generate


def _cast(builder: Any, source: Vector, target: Vector, value: Any) -> Any:
    """Write the code of a C cast, lane by lane."""
    if source.element == target.element:
        return value
    grows = target.n_bytes > source.n_bytes
    if source.is_float and target.is_float:
        return (builder.fpext if grows else builder.fptrunc)(value, target.llvm)
    if source.is_float:
        return builder.fptosi(value, target.llvm)
    if target.is_float:
        return builder.sitofp(value, target.llvm)
    return (builder.sext if grows else builder.trunc)(value, target.llvm)


@_intrinsic
def as_type_of(typing_context: Any, x: Any, array: Any) -> Any:
    """Return x with its lanes cast to an array's element type."""
    vector = Vector(array.dtype, x.lanes)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _cast(builder, x, vector, values[0])

    return vector(x, array), generate


@_intrinsic
def widened(typing_context: Any, x: Any, out: Any) -> Any:
    """Return the lanes of x in the type that sums of them are held in: int16 for int8, else that of `out`."""
    vector = Vector(types.int16 if x.element == types.int8 else out.dtype, x.lanes)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _cast(builder, x, vector, values[0])

    return vector(x, out), generate


Emit = Callable[[Any, Vector, list[Any]], Any]


def _lanewise(emit: Emit, n_arguments: int) -> Any:
    """Return an intrinsic over vectors of one type; `emit(builder, type, values)` writes its code."""

    def typed(*vectors: Any) -> Any:
        if not all(isinstance(v, Vector) and v == vectors[0] for v in vectors):
            return None

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return emit(builder, vectors[0], list(values))

        return vectors[0](*vectors), generate

    if n_arguments == 1:
        return _intrinsic(lambda typing_context, x: typed(x))
    if n_arguments == 2:
        return _intrinsic(lambda typing_context, x, y: typed(x, y))
    return _intrinsic(lambda typing_context, x, y, z: typed(x, y, z))


def _called(name: str) -> Emit:
    """Return what writes a call of an LLVM intrinsic such as 'llvm.trunc'."""

    def emit(builder: Any, vector: Vector, values: list[Any]) -> Any:
        kind = ir.FunctionType(vector.llvm, [vector.llvm] * len(values))
        full = f"{name}.v{vector.lanes}f{8 * vector.n_bytes}"
        return builder.call(builder.module.declare_intrinsic(full, fnty=kind), values)

    return emit


trunc = _lanewise(_called("llvm.trunc"), 1)
rint = _lanewise(_called("llvm.rint"), 1)
sqrt = _lanewise(_called("llvm.sqrt"), 1)
magnitude = _lanewise(_called("llvm.fabs"), 1)
larger = _lanewise(_called("llvm.maxnum"), 2)
smaller = _lanewise(_called("llvm.minnum"), 2)
fma = _lanewise(_called("llvm.fma"), 3)  # x * y + z, rounded once


def _instruction(of_floats: str, of_integers: str) -> Emit:
    return lambda builder, vector, values: getattr(builder, of_floats if vector.is_float else of_integers)(
        *values
    )


def _define(symbol: Any, emit: Emit) -> None:
    lanewise = _lanewise(emit, 2)

    @overload(symbol, strict=False)
    def _typed(x: Any, y: Any) -> Any:
        if not (isinstance(x, Vector) and x == y):
            return None
        return lambda x, y: lanewise(x, y)  # noqa: PLW0108  (Numba wants a function of Python)


_define(operator.add, _instruction("fadd", "add"))
_define(operator.sub, _instruction("fsub", "sub"))
_define(operator.mul, _instruction("fmul", "mul"))
_define(operator.truediv, _instruction("fdiv", "sdiv"))
# Of unsigned lanes, by fewer bits than they have.
_define(operator.lshift, _instruction("", "shl"))
_define(operator.rshift, _instruction("", "lshr"))
_define(operator.or_, _instruction("", "or_"))


def _comparison(symbol: str, unordered: bool) -> Any:
    def typed(typing_context: Any, x: Any, y: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return (builder.fcmp_unordered if unordered else builder.fcmp_ordered)(symbol, *values)

        return Vector(types.boolean, x.lanes)(x, y), generate

    return _intrinsic(typed)


greater = _comparison(">", unordered=False)  # false where either is NaN
differs = _comparison("!=", unordered=True)  # true where either is NaN


@_intrinsic
def either(typing_context: Any, x: Any, y: Any) -> Any:
    """Return the mask 'x or y'."""
    return x(x, y), lambda context, builder, signature, values: builder.or_(*values)


@_intrinsic
def select(typing_context: Any, mask: Any, x: Any, y: Any) -> Any:
    """Return x where the mask holds, y elsewhere."""
    return x(mask, x, y), lambda context, builder, signature, values: builder.select(*values)


@_intrinsic
def bits(typing_context: Any, mask: Any) -> Any:
    """Return a mask of fewer than 64 lanes as a number, lane 0 in its lowest bit."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        packed = builder.bitcast(values[0], ir.IntType(mask.lanes))
        return builder.zext(packed, ir.IntType(64))

    return types.uint64(mask), generate


@_intrinsic
def mask_of(typing_context: Any, number: Any, lanes: Any) -> Any:
    """Return the lowest bits of a uint64 as a mask of at most 64 lanes, bit 0 in lane 0."""
    mask = Vector(types.boolean, lanes.n)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        whole = values[0] if lanes.n == 64 else builder.trunc(values[0], ir.IntType(lanes.n))
        return builder.bitcast(whole, mask.llvm)

    return mask(types.uint64, lanes), generate


@_intrinsic
def joined(typing_context: Any, x: Any, y: Any) -> Any:
    """Return the lanes of x, then those of y."""
    both = Vector(x.element, 2 * x.lanes)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        order = ir.Constant(ir.VectorType(ir.IntType(32), both.lanes), list(range(both.lanes)))
        return builder.shuffle_vector(*values, order)

    return both(x, y), generate


def _halved(builder: Any, x: Any, value: Any, n: int) -> Any:
    """Write the code that adds the upper n of 2 n lanes to the lower ones."""
    order = ir.IntType(32)
    halves = [
        builder.shuffle_vector(
            value,
            ir.Constant(value.type, ir.Undefined),
            ir.Constant(ir.VectorType(order, n), list(range(first, first + n))),
        )
        for first in (0, n)
    ]
    return (builder.fadd if x.is_float else builder.add)(*halves)


@_intrinsic
def halved(typing_context: Any, x: Any) -> Any:
    """Return a vector of half the lanes: the upper half of x added to its lower half."""
    half = Vector(x.element, x.lanes // 2)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _halved(builder, x, values[0], half.lanes)

    return half(x), generate


@_intrinsic
def summed(typing_context: Any, x: Any) -> Any:
    """Return the sum of all lanes: its upper half is added to its lower half until one lane is left."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vector, n = values[0], x.lanes
        while n > 1:
            n //= 2
            vector = _halved(builder, x, vector, n)
        return builder.extract_element(vector, ir.Constant(ir.IntType(32), 0))

    return x.element(x), generate


@_intrinsic
def transpose(
    typing_context: Any, source: Any, at: Any, stride: Any, target: Any, place: Any, step: Any
) -> Any:
    """Write 16 x 16 elements of an array to one of the same type, rows as columns.

    Row r is read at `at + r * stride`, column c written at `place + c * step`; nothing checks the ends.
    """
    n = 16
    vector = Vector(source.dtype, n)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        read, write = (
            [builder.add(values[first], builder.mul(values[by], values[by].type(k))) for k in range(n)]
            for first, by in ((1, 2), (4, 5))
        )
        rows = []
        for offset in read:
            loaded = builder.load(_place(context, builder, source, values[0], offset, vector))
            loaded.align = vector.n_bytes
            rows.append(loaded)
        order = ir.VectorType(ir.IntType(32), n)
        mixed = [x for k in range(n // 2) for x in (k, n + k)]
        low, high = (ir.Constant(order, [x + by for x in mixed]) for by in (0, n // 2))
        # Four perfect shuffles of the rows k and k + 8 turn 16 rows into 16 columns.
        for _ in range(4):
            pairs = [(rows[k], rows[k + n // 2]) for k in range(n // 2)]
            rows = [builder.shuffle_vector(a, b, half) for a, b in pairs for half in (low, high)]
        for offset, column in zip(write, rows, strict=True):
            to = _place(context, builder, target, values[3], offset, vector)
            builder.store(column, to).align = vector.n_bytes
        return context.get_dummy_value()

    intp = types.intp
    return types.void(source, intp, intp, target, intp, intp), generate


@_intrinsic
def power_of_two(typing_context: Any, n: Any) -> Any:
    """Return 2**n for whole numbers n within the normal range of their type."""
    bias, mantissa_bits, integer = (127, 23, 32) if n.element == types.float32 else (1023, 52, 64)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        whole = ir.VectorType(ir.IntType(integer), n.lanes)
        exponent = builder.add(builder.fptosi(values[0], whole), ir.Constant(whole, [bias] * n.lanes))
        return builder.bitcast(builder.shl(exponent, ir.Constant(whole, [mantissa_bits] * n.lanes)), n.llvm)

    return n(n), generate


def _bit_operation(name: str) -> Any:
    def typed(typing_context: Any, x: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            if name == "count":
                return builder.ctpop(values[0])
            return builder.cttz(values[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.uint64), generate

    return _intrinsic(typed)


count_bits = _bit_operation("count")
lowest_bit = _bit_operation("lowest")  # the number of the lowest set bit; x must not be 0
