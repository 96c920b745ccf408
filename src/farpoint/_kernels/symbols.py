"""Numbers that write down what is done with them.

`formulas` runs a function with symbols in place of its numbers, and what they wrote is its code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import llvmlite.ir as llvm

__all__ = [
    "BOOLEAN",
    "INTEGER",
    "NUMBER",
    "ArraySymbol",
    "Code",
    "Symbol",
    "choose",
    "exponent_and_mantissa",
    "greater",
    "lesser",
    "root",
    "symbol_among",
    "whole",
    "with_sign_of",
]

NUMBER, INTEGER, BOOLEAN = llvm.DoubleType(), llvm.IntType(64), llvm.IntType(1)


@dataclass(frozen=True)
class Code:
    """What is being written.

    Attributes
    ----------
    builder : llvmlite.ir.IRBuilder
    flags : tuple of str
        Liberties that the compiler may take with numbers.
    """

    builder: Any
    flags: tuple[str, ...]

    def intrinsic(self, name: str, *numbers: Any) -> Symbol:
        """The number that a function of the processor's makes of these."""
        kind = llvm.FunctionType(NUMBER, [NUMBER] * len(numbers))
        called = self.builder.module.declare_intrinsic(name, [NUMBER], kind)
        return Symbol(self, self.builder.call(called, numbers, fastmath=self.flags))


class Symbol:
    """A number, an index (not negative) or a truth value."""

    __slots__ = ("code", "value")

    def __init__(self, code: Code, value: Any) -> None:
        self.code = code
        self.value = value

    def like(self, other: Any) -> Any:
        """The operand ``other``, a symbol or a constant, as the compiler takes it."""
        if isinstance(other, Symbol):
            return other.value
        return llvm.Constant(self.value.type, float(other) if self._is_number else int(other))

    @property
    def _is_number(self) -> bool:
        return self.value.type is NUMBER

    def _write(self, number: str, index: str | None, first: Any, second: Any) -> Symbol:
        builder = self.code.builder
        if self._is_number:
            value = getattr(builder, number)(first, second, flags=self.code.flags)
        else:
            value = getattr(builder, str(index))(first, second)
        return Symbol(self.code, value)

    def _compare(self, sign: str, other: Any) -> Symbol:
        builder, second = self.code.builder, self.like(other)
        if self._is_number:
            value = builder.fcmp_ordered(sign, self.value, second, flags=self.code.flags)
        else:
            value = builder.icmp_signed(sign, self.value, second)
        return Symbol(self.code, value)

    def __add__(self, other: Any) -> Symbol:
        return self._write("fadd", "add", self.value, self.like(other))

    def __radd__(self, other: Any) -> Symbol:
        return self._write("fadd", "add", self.like(other), self.value)

    def __sub__(self, other: Any) -> Symbol:
        return self._write("fsub", "sub", self.value, self.like(other))

    def __rsub__(self, other: Any) -> Symbol:
        return self._write("fsub", "sub", self.like(other), self.value)

    def __mul__(self, other: Any) -> Symbol:
        return self._write("fmul", "mul", self.value, self.like(other))

    def __rmul__(self, other: Any) -> Symbol:
        return self._write("fmul", "mul", self.like(other), self.value)

    def __truediv__(self, other: Any) -> Symbol:
        return self._write("fdiv", None, self.value, self.like(other))

    def __rtruediv__(self, other: Any) -> Symbol:
        return self._write("fdiv", None, self.like(other), self.value)

    def __floordiv__(self, other: Any) -> Symbol:
        return self._write("", "udiv", self.value, self.like(other))

    def __mod__(self, other: Any) -> Symbol:
        return self._write("", "urem", self.value, self.like(other))

    def __and__(self, other: Any) -> Symbol:
        return self._write("", "and_", self.value, self.like(other))

    def __or__(self, other: Any) -> Symbol:
        return self._write("", "or_", self.value, self.like(other))

    def __neg__(self) -> Symbol:
        return Symbol(self.code, self.code.builder.fneg(self.value))

    def __abs__(self) -> Symbol:
        return self.code.intrinsic("llvm.fabs", self.value)

    def __lt__(self, other: Any) -> Symbol:
        return self._compare("<", other)

    def __le__(self, other: Any) -> Symbol:
        return self._compare("<=", other)

    def __gt__(self, other: Any) -> Symbol:
        return self._compare(">", other)

    def __ge__(self, other: Any) -> Symbol:
        return self._compare(">=", other)

    def __bool__(self) -> bool:
        raise TypeError("a formula has no branches: `choose` takes one of two values")


class ArraySymbol:
    """An array, with indices from its beginning and so many elements from one to the next."""

    def __init__(self, code: Code, data: Any, strides: list[Any]) -> None:
        self._code = code
        self._data = data
        self._strides = strides

    def _place(self, index: Any) -> Any:
        builder = self._code.builder
        indices = index if isinstance(index, tuple) else (index,)
        at = None
        for i, stride in zip(indices, self._strides, strict=True):
            steps = i.value if isinstance(i, Symbol) else llvm.Constant(INTEGER, int(i))
            part = steps if stride is None else builder.mul(steps, stride)
            at = part if at is None else builder.add(at, part)
        return builder.gep(self._data, [at], inbounds=True)

    def __getitem__(self, index: Any) -> Symbol:
        return Symbol(self._code, self._code.builder.load(self._place(index)))

    def __setitem__(self, index: Any, value: Any) -> None:
        if not isinstance(value, Symbol):
            value = Symbol(self._code, llvm.Constant(self._data.type.pointee, value))
        self._code.builder.store(value.value, self._place(index))


def symbol_among(a: Any, b: Any, c: Any = None) -> Symbol | None:
    """The first of these that is a symbol."""
    if isinstance(a, Symbol):
        return a
    if isinstance(b, Symbol):
        return b
    return c if isinstance(c, Symbol) else None


def root(x: Any) -> Any:
    """Square root of a number that is not negative."""
    return x.code.intrinsic("llvm.sqrt", x.value) if isinstance(x, Symbol) else math.sqrt(x)


def with_sign_of(sign: Any, size: Any) -> Any:
    """``size`` with the sign of ``sign``."""
    symbol = symbol_among(sign, size)
    if symbol is None:
        return math.copysign(size, sign)
    return symbol.code.intrinsic("llvm.copysign", symbol.like(size), symbol.like(sign))


def choose(condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition holds, else ``b``; both are computed."""
    if not isinstance(condition, Symbol):
        return a if condition else b
    symbol = symbol_among(a, b)
    if symbol is None:
        symbol = Symbol(condition.code, llvm.Constant(NUMBER, a))
    value = condition.code.builder.select(condition.value, symbol.like(a), symbol.like(b))
    return Symbol(condition.code, value)


def lesser(a: Any, b: Any) -> Any:
    """``min(a, b)``."""
    return choose(b < a, b, a)


def greater(a: Any, b: Any) -> Any:
    """``max(a, b)``."""
    return choose(b > a, b, a)


def whole(x: Any) -> Any:
    """The number without its fraction, as an index."""
    if not isinstance(x, Symbol):
        return int(x)
    return Symbol(x.code, x.code.builder.fptosi(x.value, INTEGER))


def exponent_and_mantissa(x: Any) -> tuple[Any, Any]:
    """``e`` and ``m``, from 1 to 2, of a positive normal number ``m 2^e``; both are numbers."""
    if not isinstance(x, Symbol):
        mantissa, exponent = math.frexp(x)
        return exponent - 1.0, 2.0 * mantissa
    builder = x.code.builder
    bits = builder.bitcast(x.value, INTEGER)
    # By way of 32 bits, which processors make numbers of several at a time.
    exponent = builder.trunc(builder.lshr(bits, llvm.Constant(INTEGER, 52)), llvm.IntType(32))
    mantissa = builder.and_(bits, llvm.Constant(INTEGER, 0x000FFFFFFFFFFFFF))
    mantissa = builder.or_(mantissa, llvm.Constant(INTEGER, 0x3FF0000000000000))
    number = Symbol(x.code, builder.sitofp(exponent, NUMBER))
    return number - 1023.0, Symbol(x.code, builder.bitcast(mantissa, NUMBER))
