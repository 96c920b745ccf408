"""Arithmetic on single numbers, for vector instructions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin, type_callable

from farpoint._kernels.compile import inlined_kernel

__all__ = ["exponent_and_mantissa", "fma", "where"]


def fma(a: Any, b: Any, c: Any) -> Any:
    """``a b + c``, rounded once in compiled code.

    The operation is explicit, so that every loop gives the same digits. A compiler that is allowed
    to fuse products and sums would fuse them differently in different loops.
    """
    return a * b + c


@type_callable(fma)
def _type_of_fma(_context: Any) -> Any:
    return lambda a, b, c: a if a == b == c else types.float64


@lower_builtin(fma, types.Float, types.Float, types.Float)
def _lower_fma(_context: Any, builder: Any, _signature: Any, numbers: Any) -> Any:
    return builder.fma(*numbers)


@inlined_kernel
def where(condition: bool, a: float, b: float) -> float:
    """``a`` if the condition holds, else ``b``. Both ``a`` and ``b`` are computed."""
    return a if condition else b


@inlined_kernel
def exponent_and_mantissa(x: float) -> tuple[float, float]:
    """``e`` and ``m`` (from 1 to 2) of a positive normal number ``m 2^e``, both as floats."""
    bits = np.float64(x).view(np.int64)
    # The exponent becomes a 32-bit integer, because processors have vector conversions from 32-bit
    # integers to floats.
    exponent = np.int32(bits >> 52)
    mantissa = np.int64((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000)
    return exponent - 1023.0, mantissa.view(np.float64)
