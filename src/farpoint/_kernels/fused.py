"""Multiply and add in one instruction."""

from __future__ import annotations

from typing import Any

import llvmlite.ir
from numba import types
from numba.extending import lower_builtin, type_callable

from farpoint._kernels.symbols import symbol_among

__all__ = ["fused"]


def fused(a: Any, b: Any, c: Any) -> Any:
    """``a b + c``, rounded once where the processor can.

    Said so in the formulas, every loop has the same digits; a compiler that is free to fuse what it
    likes does so differently from loop to loop.
    """
    symbol = symbol_among(a, b, c)
    if symbol is None:
        return a * b + c
    return symbol.code.intrinsic("llvm.fmuladd", *(symbol.like(x) for x in (a, b, c)))


@type_callable(fused)
def _type(_context: Any) -> Any:
    return lambda a, b, c: a if a == b == c else types.float64


@lower_builtin(fused, types.Float, types.Float, types.Float)
def _lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    number = context.get_value_type(signature.return_type)
    function = llvmlite.ir.FunctionType(number, [number] * 3)
    fmuladd = builder.module.declare_intrinsic("llvm.fmuladd", [number], function)
    return builder.call(fmuladd, arguments)
