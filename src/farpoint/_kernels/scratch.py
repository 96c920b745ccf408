"""Arrays within a kernel: those of a known shape on the stack, where they cost nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable
from numba.np.arrayobj import populate_array

__all__ = ["clear", "copy", "index_room", "index_scratch", "room", "scratch"]


def scratch(rows: int, columns: int | None = None) -> np.ndarray:
    """Array of numbers, not yet written, that ends with the kernel; its shape is constant."""
    return np.empty(rows if columns is None else (rows, columns))


def index_scratch(size: int) -> np.ndarray:
    """As `scratch`, of indices."""
    return np.empty(size, np.int64)


def room(size: int) -> np.ndarray:
    """Array of as many numbers, not yet written, which a kernel may return.

    What `numpy.empty` is in Python. In a kernel numba would compile three functions for that.
    """
    return np.empty(size)


def index_room(size: int) -> np.ndarray:
    """As `room`, of indices."""
    return np.empty(size, np.int64)


def copy(source: np.ndarray, target: np.ndarray) -> None:
    """``target[...] = source``, both in C order and of one size, which no kernel checks."""
    target[...] = source


def clear(target: np.ndarray) -> None:
    """``target[...] = 0``."""
    target[...] = 0.0


def _array(dtype: Any, *shape: Any) -> Any:
    """Numba's type of an array of this shape; None where that is not constant."""
    if all(isinstance(size, types.IntegerLiteral) for size in shape):
        return types.Array(dtype, len(shape), "C")
    return None


@type_callable(scratch)
def _type_of_scratch(_context: Any) -> Any:
    def result(rows: Any, columns: Any = None) -> Any:
        return _array(types.float64, *((rows,) if columns is None else (rows, columns)))

    return result


@type_callable(index_scratch)
def _type_of_index_scratch(_context: Any) -> Any:
    return lambda size: _array(types.int64, size)


@type_callable(room)
def _type_of_room(_context: Any) -> Any:
    return lambda size: types.Array(types.float64, 1, "C") if size in types.integer_domain else None


@type_callable(index_room)
def _type_of_index_room(_context: Any) -> Any:
    return lambda size: types.Array(types.int64, 1, "C") if size in types.integer_domain else None


@lower_builtin(scratch, types.IntegerLiteral)
@lower_builtin(scratch, types.IntegerLiteral, types.IntegerLiteral)
@lower_builtin(index_scratch, types.IntegerLiteral)
def _lower(context: Any, builder: Any, signature: Any, _shape: Any) -> Any:
    kind, index = signature.return_type, context.get_value_type(types.intp)
    sizes = [index(size.literal_value) for size in signature.args]
    element = context.get_data_type(kind.dtype)
    data = cgutils.alloca_once(
        builder, llvm.ArrayType(element, math.prod(x.constant for x in sizes))
    )
    return _filled(context, builder, kind, data, sizes, None)


@lower_builtin(room, types.Integer)
@lower_builtin(index_room, types.Integer)
def _lower_room(context: Any, builder: Any, signature: Any, sizes: Any) -> Any:
    bytes_needed = builder.mul(sizes[0], sizes[0].type(8))
    info = context.nrt.meminfo_alloc_aligned(builder, bytes_needed, 64)
    data = context.nrt.meminfo_data(builder, info)
    return _filled(context, builder, signature.return_type, data, sizes, info)


@type_callable(copy)
def _type_of_copy(_context: Any) -> Any:
    return lambda source, target: types.none if source.layout == target.layout == "C" else None


@type_callable(clear)
def _type_of_clear(_context: Any) -> Any:
    return lambda target: types.none if target.layout == "C" else None


@lower_builtin(copy, types.Array, types.Array)
def _lower_copy(context: Any, builder: Any, signature: Any, arrays: Any) -> Any:
    source, target = (
        context.make_array(kind)(context, builder, array)
        for kind, array in zip(signature.args, arrays, strict=True)
    )
    cgutils.raw_memmove(builder, target.data, source.data, source.nitems, itemsize=8)
    return context.get_dummy_value()


@lower_builtin(clear, types.Array)
def _lower_clear(context: Any, builder: Any, signature: Any, arrays: Any) -> Any:
    target = context.make_array(signature.args[0])(context, builder, arrays[0])
    size = builder.mul(target.nitems, target.nitems.type(8))
    cgutils.memset(builder, target.data, size, 0)
    return context.get_dummy_value()


def _filled(context: Any, builder: Any, kind: Any, data: Any, sizes: Any, info: Any) -> Any:
    """An array of numba's, in C order."""
    index = context.get_value_type(types.intp)
    strides = [index(8)]
    for size in sizes[:0:-1]:
        strides.insert(0, builder.mul(strides[0], size))
    array = context.make_array(kind)(context, builder)
    element = context.get_data_type(kind.dtype)
    populate_array(
        array,
        data=builder.bitcast(data, element.as_pointer()),
        shape=sizes,
        strides=strides,
        itemsize=index(8),
        meminfo=info,
    )
    return array._getvalue()
