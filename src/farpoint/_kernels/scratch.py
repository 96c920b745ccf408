"""Small arrays of a known shape, within a kernel: on the stack, where they cost nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable
from numba.np.arrayobj import populate_array

__all__ = ["index_scratch", "scratch"]


def scratch(rows: int, columns: int | None = None) -> np.ndarray:
    """Array of numbers, not yet written, that ends with the kernel; its shape is constant."""
    return np.empty(rows if columns is None else (rows, columns))


def index_scratch(size: int) -> np.ndarray:
    """As `scratch`, of indices."""
    return np.empty(size, np.int64)


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


@lower_builtin(scratch, types.IntegerLiteral)
@lower_builtin(scratch, types.IntegerLiteral, types.IntegerLiteral)
@lower_builtin(index_scratch, types.IntegerLiteral)
def _lower(context: Any, builder: Any, signature: Any, _shape: Any) -> Any:
    kind = signature.return_type
    sizes = [size.literal_value for size in signature.args]
    element, index = context.get_data_type(kind.dtype), context.get_value_type(types.intp)
    room = cgutils.alloca_once(builder, llvm.ArrayType(element, math.prod(sizes)))
    array = context.make_array(kind)(context, builder)
    populate_array(
        array,
        data=builder.bitcast(room, element.as_pointer()),
        shape=[index(size) for size in sizes],
        strides=[index(8 * math.prod(sizes[axis + 1 :])) for axis in range(len(sizes))],
        itemsize=index(8),
        meminfo=None,
    )
    return array._getvalue()
