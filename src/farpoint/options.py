"""What a user may give as an option: a number of the declared kind, in its range."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Integral, Real
from typing import Any

from farpoint.errors import InputError

__all__ = ["settle_float", "settle_int", "settle_positive"]

# No option of this program is meaningful beyond: squares and products of a few stay finite.
_LARGEST = 1e9
_LEAST = 1e-15  # of a positive number


def settle_float(
    options: object, expected: str, holds: Callable[[float], bool], *names: str
) -> None:
    """Make the named fields of a record of options numbers up to 1e9, of Python's ``float``.

    Whatever was given for it, a ``2`` or a number of NumPy's: to a compiled kernel these would be
    other types.

    Parameters
    ----------
    options : object
        A dataclass, frozen or not; called from its ``__post_init__``.
    expected : str
        What is expected of the fields, for the message.
    holds : callable
        Whether a number is that.
    *names : str
        The fields.

    Raises
    ------
    InputError
        With the field, and what was expected there.
    """
    _settle(options, names, float, Real, expected, holds)


def settle_positive(options: object, *names: str) -> None:
    """Make the named fields positive numbers, 1e-15 to 1e9, as `settle_float` does."""
    settle_float(options, "a positive number", lambda number: number >= _LEAST, *names)


def settle_int(options: object, least: int, *names: str, most: float = math.inf) -> None:
    """Make the named fields whole numbers of ``least`` or more, as `settle_float` does floats."""
    expected = f"a whole number, {least} " + ("or more" if math.isinf(most) else f"to {most}")
    _settle(options, names, int, Integral, expected, lambda number: least <= number <= most)


def _settle(
    options: object,
    names: tuple[str, ...],
    kind: type,
    given_as: type,
    expected: str,
    holds: Callable[[Any], bool],
) -> None:
    for name in names:
        value = getattr(options, name)
        number = _number(value, kind, given_as)
        # Not of NaN either.
        if number is None or not holds(number):
            raise InputError(f"expected {expected}, got {value!r}", field=name)
        if not abs(number) <= _LARGEST:
            raise InputError(f"expected {expected}, got {value!r}, more than 1e9", field=name)
        object.__setattr__(options, name, number)


def _number(value: object, kind: type, given_as: type) -> Any:
    """The value as Python's own number of a ``kind``; None of what is no such number."""
    if isinstance(value, bool) or not isinstance(value, given_as):
        return None
    try:
        return kind(value)
    except OverflowError:  # a whole number too large for a float
        return None
