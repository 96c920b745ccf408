"""Validation of options: each number must be of the declared kind and in the valid range."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Integral, Real
from typing import Any

from farpoint.errors import InputError

__all__ = ["coerce_float", "coerce_int", "coerce_positive"]

_LARGEST = 1e9  # so that squares and products of a few options stay finite
_LEAST = 1e-15  # smallest positive number


def coerce_float(
    options: object, expected: str, is_valid: Callable[[float], bool], *names: str
) -> None:
    """Coerce the named fields of an options record to ``float``, and validate the values.

    Integers and NumPy scalars are converted, because a compiled kernel has one argument type. The
    magnitude is at most 1e9.

    Parameters
    ----------
    options : object
        A dataclass, frozen or not, whose ``__post_init__`` calls this function.
    expected : str
        The valid range in words, for the message.
    is_valid : callable
        Function that returns whether a number is valid.
    *names : str
        Names of the fields.

    Raises
    ------
    InputError
        If a value is invalid. The message has the field and the expected range.
    """
    _coerce(options, names, float, Real, expected, is_valid)


def coerce_positive(options: object, *names: str) -> None:
    """Coerce the named fields to positive numbers, 1e-15 to 1e9."""
    coerce_float(options, "a positive number", lambda number: number >= _LEAST, *names)


def coerce_int(options: object, least: int, *names: str, most: float = math.inf) -> None:
    """Coerce the named fields to whole numbers in ``[least, most]``."""
    expected = f"a whole number, {least} " + ("or more" if math.isinf(most) else f"to {most}")
    _coerce(options, names, int, Integral, expected, lambda number: least <= number <= most)


def _coerce(
    options: object,
    names: tuple[str, ...],
    kind: type,
    given_as: type,
    expected: str,
    is_valid: Callable[[Any], bool],
) -> None:
    for name in names:
        value = getattr(options, name)
        number = _number(value, kind, given_as)
        if number is None or not is_valid(number):  # NaN fails every comparison
            raise InputError(f"expected {expected}, got {value!r}", field=name)
        if not abs(number) <= _LARGEST:
            raise InputError(f"expected {expected}, got {value!r}, more than 1e9", field=name)
        object.__setattr__(options, name, number)


def _number(value: object, kind: type, given_as: type) -> Any:
    """The value as Python's ``float`` or ``int``; None if the value is of another kind."""
    if isinstance(value, bool) or not isinstance(value, given_as):
        return None
    try:
        return kind(value)
    except OverflowError:  # a whole number too large for a float
        return None
