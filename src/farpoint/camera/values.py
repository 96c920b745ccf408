"""Checks of the arguments of a lens model: scalars, and rows of numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from farpoint.errors import InputError

__all__ = ["as_rows", "finite", "in_blocks", "parameter_values", "positive", "within"]

# Few enough rows that a dozen temporary arrays stay in the processor's second-level cache: a
# million pixels in such blocks take 1/4 of the time that they take in one block.
BLOCK_ROWS = 8192

_LARGEST = 1e12
"""Largest magnitude of a parameter. No lens needs a larger one, and powers and products of larger
parameters could overflow."""


def finite(name: str, value: Any) -> float:
    """The parameter as a finite float, or an InputError that names the parameter."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"expected a number, got {value!r}", field=name) from None
    if not math.isfinite(number):
        raise InputError(f"expected a finite number, got {number}", field=name)
    if abs(number) > _LARGEST:
        raise InputError(f"expected a number up to {_LARGEST:g}, got {number:g}", field=name)
    return number


def positive(name: str, value: Any) -> float:
    """The parameter as a positive finite float, or an InputError with its name."""
    number = finite(name, value)
    if number <= 0:
        raise InputError(f"expected a positive number, got {number:g}", field=name)
    return number


def within(name: str, value: Any, low: float, high: float) -> float:
    """The parameter as a float between two bounds, or an InputError with its name."""
    number = finite(name, value)
    if not low <= number <= high:
        raise InputError(f"expected a number from {low:g} to {high:g}, got {number:g}", field=name)
    return number


def parameter_values(
    current: Mapping[str, float],
    values: np.ndarray | Mapping[str, float],
    field: str = "values",
) -> dict[str, float]:
    """Values by parameter name, from an array of all values or a mapping of some values."""
    if isinstance(values, Mapping):
        unknown = [str(name) for name in values if name not in current]
        if unknown:
            raise InputError(
                f"unknown parameter {unknown[0]!r}; expected some of {', '.join(current)}",
                field=field,
            )
        given = {**current, **values}
    else:
        listed = np.asarray(values, dtype=object)
        if listed.shape != (len(current),):
            raise InputError(
                f"expected shape ({len(current)},) for {', '.join(current)}, got {listed.shape}",
                field=field,
            )
        given = dict(zip(current, listed, strict=True))
    return {name: finite(name, value) for name, value in given.items()}


def as_rows(values: Any, columns: int, name: str) -> np.ndarray:
    """The argument as float64 of shape (N, columns), or an InputError with its name."""
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"expected numbers of shape (N, {columns})", field=name) from None
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise InputError(f"expected shape (N, {columns}), got {rows.shape}", field=name)
    return rows


def in_blocks(
    function: Callable[[np.ndarray], np.ndarray], rows: np.ndarray, columns: int
) -> np.ndarray:
    """Apply a row-by-row function, (N, k) -> (N, columns), to blocks that fit into the cache.

    Floating-point warnings are off, because a lens model uses invalid values to find the rows that
    become NaN.
    """
    rows = np.asarray(rows, dtype=np.float64)
    with np.errstate(all="ignore"):
        if len(rows) <= BLOCK_ROWS:
            return function(rows)
        out = np.empty((len(rows), columns))
        for start in range(0, len(rows), BLOCK_ROWS):
            part = slice(start, start + BLOCK_ROWS)
            out[part] = function(rows[part])
        return out
