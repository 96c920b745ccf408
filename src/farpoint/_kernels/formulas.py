"""Formulas: functions without branches, which the compiler gets by running them.

numba asks of every operation what its types are and writes it down by way of many layers: some half
a millisecond each. A formula is run once with `symbols` in place of its numbers, which takes a
fiftieth of that. What it does to tuples, and loops of known length, are gone by then.

To Python a formula is a function like any other. Kernels call it with numbers, truth values,
arrays, and tuples of all these; it returns the same, without arrays.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import Any, TypeVar

import llvmlite.ir as llvm
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable

from farpoint._kernels.symbols import (
    BOOLEAN,
    INTEGER,
    NUMBER,
    ArraySymbol,
    Code,
    Symbol,
    choose,
    exponent_and_mantissa,
    greater,
    lesser,
    root,
    whole,
    with_sign_of,
)

try:
    from farpoint._kernels.linking import inner_library
except (ImportError, AttributeError):  # a numba with other inner parts compiles in its own way

    def inner_library(codegen: Any, name: str) -> Any:
        """Code for callers."""
        return codegen.create_library(name)


__all__ = [
    "choose",
    "exponent_and_mantissa",
    "formula",
    "greater",
    "lesser",
    "root",
    "sum_formula",
    "whole",
    "with_sign_of",
]

Function = TypeVar("Function", bound=Callable[..., Any])

_SCALARS = {types.float64: NUMBER, types.int64: INTEGER, types.uint64: INTEGER}
_SCALARS |= {types.boolean: BOOLEAN}
_TUPLE: Any = types.BaseTuple
_number = partial(next, count())


@dataclass(frozen=True)
class _Written:
    """A formula for arguments of certain types: code, its type, and numba's of what it returns."""

    function: Any
    kind: Any
    result: Any


def _llvm_types(kind: Any) -> Iterator[Any]:
    """What an argument of numba's type ``kind`` is handed over as."""
    kind = types.unliteral(kind)
    if isinstance(kind, _TUPLE):
        for part in kind.types:
            yield from _llvm_types(part)
    elif isinstance(kind, types.Array):
        yield _SCALARS[kind.dtype].as_pointer()
        yield from [INTEGER] * _strides_told(kind)
    else:
        yield _SCALARS[kind]


def _strides_told(array: Any) -> int:
    """Axes of which is handed over how far apart elements are: not the last one, in C order."""
    return array.ndim - (array.layout == "C")


def _symbol(kind: Any, code: Code, values: Iterator[Any]) -> Any:
    """An argument for the formula, of what was handed over."""
    kind = types.unliteral(kind)
    if isinstance(kind, _TUPLE):
        return tuple(_symbol(part, code, values) for part in kind.types)
    if isinstance(kind, types.Array):
        data, strides = next(values), [next(values) for _ in range(_strides_told(kind))]
        return ArraySymbol(code, data, [*strides, None][: kind.ndim])
    return Symbol(code, next(values))


def _handed_over(context: Any, builder: Any, kind: Any, value: Any) -> Iterator[Any]:
    """A value of numba's as `_llvm_types` says."""
    if isinstance(kind, _TUPLE):
        for part, element in zip(kind.types, cgutils.unpack_tuple(builder, value), strict=True):
            yield from _handed_over(context, builder, part, element)
    elif isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        yield array.data
        strides = cgutils.unpack_tuple(builder, array.strides)[: _strides_told(kind)]
        yield from (builder.sdiv(stride, stride.type(8)) for stride in strides)
    else:
        yield value


def _returned(value: Any) -> tuple[Any, list[Any]]:
    """The type, as numba names it, of what a formula returned, and its numbers."""
    if value is None:
        return types.none, []
    if isinstance(value, tuple):
        parts = [_returned(part) for part in value]
        return types.Tuple([kind for kind, _ in parts]), [
            x for _, numbers in parts for x in numbers
        ]
    if not isinstance(value, Symbol):
        value = llvm.Constant(NUMBER, float(value))
        return types.float64, [value]
    for kind in (types.float64, types.int64, types.boolean):
        if value.value.type == _SCALARS[kind]:
            return kind, [value.value]
    raise TypeError(f"a formula returns numbers, not {value.value.type}")


def _packed(context: Any, builder: Any, kind: Any, numbers: Iterator[Any]) -> Any:
    """What a formula returned, as numba takes it."""
    if kind is types.none:
        return context.get_dummy_value()
    if isinstance(kind, _TUPLE):
        parts = [_packed(context, builder, part, numbers) for part in kind.types]
        return context.make_tuple(builder, kind, parts)
    return next(numbers)


def _write(
    function: Callable[..., Any], kinds: tuple[Any, ...], flags: tuple[str, ...]
) -> _Written:
    name = f"{function.__module__}.{function.__qualname__}.{_number()}"
    arguments = [each for kind in kinds for each in _llvm_types(kind)]
    written = llvm.Function(llvm.Module(name), llvm.FunctionType(llvm.VoidType(), arguments), name)
    written.attributes.add("alwaysinline")
    code = Code(llvm.IRBuilder(written.append_basic_block("entry")), flags)
    values = iter(written.args)
    result, numbers = _returned(function(*(_symbol(kind, code, values) for kind in kinds)))
    # Only now is known what it returns.
    returned = llvm.LiteralStructType([number.type for number in numbers])
    written.return_value = llvm.values.ReturnValue(written, returned)
    code.builder.ret(_struct(code.builder, returned, numbers))
    return _Written(written, llvm.FunctionType(returned, arguments), result)


def _struct(builder: Any, kind: Any, numbers: list[Any]) -> Any:
    struct = llvm.Constant(kind, llvm.Undefined)
    for i, number in enumerate(numbers):
        struct = builder.insert_value(struct, number, i)
    return struct


def _formula(flags: tuple[str, ...], function: Function) -> Function:
    written: dict[tuple[Any, ...], _Written] = {}
    libraries: dict[tuple[Any, ...], Any] = {}

    @type_callable(function)
    def type_of(_context: Any) -> Any:
        def result(*kinds: Any) -> Any:
            if kinds not in written:
                written[kinds] = _write(function, kinds, flags)
            return written[kinds].result

        result.pysig = inspect.signature(function)  # pyright: ignore[reportFunctionMemberAccess]
        return result

    @lower_builtin(function, types.VarArg(types.Any))
    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        formula = written[signature.args]
        if signature.args not in libraries:
            library = inner_library(context.codegen(), formula.function.name)
            library.add_ir_module(formula.function.module)
            library.finalize()
            libraries[signature.args] = library
        context.add_linking_libs([libraries[signature.args]])
        called = cgutils.get_or_insert_function(builder.module, formula.kind, formula.function.name)
        arguments = (
            each
            for kind, value in zip(signature.args, values, strict=True)
            for each in _handed_over(context, builder, kind, value)
        )
        returned = builder.call(called, list(arguments))
        numbers = iter(cgutils.unpack_tuple(builder, returned))
        return _packed(context, builder, signature.return_type, numbers)

    return function


# A function without branches, computed as it is written.
formula = partial(_formula, ())

# One that adds terms of a sum, in any order.
sum_formula = partial(_formula, ("reassoc", "contract", "nsz"))

for _primitive in (root, with_sign_of, choose, lesser, greater, whole, exponent_and_mantissa):
    formula(_primitive)
