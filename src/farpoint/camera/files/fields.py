"""Typed access to the values of a file, with errors that name the file and the field."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from farpoint.errors import InputError

__all__ = ["Fields", "blame"]

LARGEST_SIDE_PX = 1_000_000
"""Largest width or height of an image, px."""


@dataclass(frozen=True)
class Fields:
    """A mapping read from a file.

    Attributes
    ----------
    values : mapping
        Mapping from key to text, number, list or mapping.
    file : Path
        File that the error messages name.
    within : str
        Prefix of the keys in error messages, such as ``"cam0."``.
    read : set of str
        Keys whose values were read, so that fields that were not read can be found.
    groups : dict
        The groups of fields that were read, by key.
    """

    values: Mapping[str, Any]
    file: Path
    within: str = ""
    read: set[str] = field(default_factory=set, compare=False)
    groups: dict[str, Fields] = field(default_factory=dict, compare=False)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def place(self, key: str) -> str:
        """Name of a key in error messages."""
        return self.within + key

    def error(self, key: str, problem: str) -> InputError:
        """An error about one key."""
        return InputError(problem, file=self.file, field=self.place(key))

    def first(self, *keys: str) -> str | None:
        """The first of the keys that is present."""
        return next((key for key in keys if key in self.values), None)

    def group(self, key: str) -> Fields:
        """The mapping under a key."""
        value = self._required(key)
        if not isinstance(value, Mapping):
            raise self.error(key, f"expected a group of fields, got {_short(value)}")
        found = Fields(value, self.file, f"{self.place(key)}.")
        return self.groups.setdefault(key, found)

    def text(self, key: str) -> str:
        """The text under a key, without leading and trailing spaces."""
        value = self._required(key)
        if isinstance(value, list | Mapping):
            raise self.error(key, f"expected a word, got {_short(value)}")
        return str(value).strip().strip("\"'")

    def number(self, key: str) -> float:
        """The finite number under a key."""
        return self._as_number(key, self._required(key))

    def numbers(self, key: str, counts: Collection[int] | None = None) -> list[float]:
        """The finite numbers under a key, which may be a list, nested lists, a matrix or a text.

        Parameters
        ----------
        key : str
            Key of the numbers.
        counts : collection of int, optional
            Allowed counts of numbers; any count by default.
        """
        value = self._required(key)
        if _hides_groups(value):
            raise self.error(key, f"expected numbers, got {_short(value)}")
        values = [self._as_number(key, item) for item in _flat(value)]
        if counts is not None and len(values) not in counts:
            wanted = " or ".join(map(str, counts))
            raise self.error(key, f"expected {wanted} numbers, got {len(values)}")
        return values

    def size(self, width_key: str, height_key: str) -> tuple[int, int] | None:
        """Image width and height, px, under two keys; None if both keys are absent."""
        if width_key not in self and height_key not in self:
            return None
        return self._as_pixels(width_key, self.number(width_key)), self._as_pixels(
            height_key, self.number(height_key)
        )

    def size_pair(self, key: str) -> tuple[int, int] | None:
        """Image width and height, px, in a list under one key; None if the key is absent."""
        if key not in self:
            return None
        width, height = self.numbers(key, (2,))
        return self._as_pixels(key, width), self._as_pixels(key, height)

    def _required(self, key: str) -> Any:
        if key not in self.values or self.values[key] is None:
            raise self.error(key, "the field is missing")
        self.read.add(key)
        return self.values[key]

    def _as_number(self, key: str, value: Any) -> float:
        try:
            # YAML writes .nan and .inf.
            number = float(str(value).lower().replace(".nan", "nan").replace(".inf", "inf"))
        except (TypeError, ValueError):
            raise self.error(key, f"expected a number, got {_short(value)}") from None
        if not math.isfinite(number):
            raise self.error(key, f"expected a finite number, got {value}")
        return number

    def _as_pixels(self, key: str, value: float) -> int:
        if not (value > 0 and value == int(value)):
            raise self.error(key, f"expected a positive whole number of pixels, got {value:g}")
        if value > LARGEST_SIDE_PX:
            raise self.error(key, f"expected at most {LARGEST_SIDE_PX} pixels, got {value:g}")
        return int(value)


@contextmanager
def blame(fields: Fields, key: str, **keys: str) -> Iterator[None]:
    """Add the file and the field to an error about a lens parameter.

    Parameters
    ----------
    fields : Fields
        The fields that are being read.
    key : str
        The field that holds the parameters.
    **keys : str
        For single parameters, by name: the field that holds the parameter in place of ``key``.
    """
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        parameter = error.field or ""
        at = fields.place(keys.get(parameter.split(" ")[0], key))
        name = f"{at} ({parameter})" if parameter else at
        raise InputError(error.problem, file=fields.file, field=name) from None


def _flat(value: Any) -> list[Any]:
    """The items of a list, of nested lists, of the ``data`` of a matrix, or of a text with spaces
    or commas.
    """
    if isinstance(value, Mapping):
        return _flat(value.get("data", []))
    if isinstance(value, list):
        return [item for part in value for item in _flat(part)]
    if isinstance(value, str):
        return value.replace(",", " ").split()
    return [value]


def _hides_groups(value: Any) -> bool:
    """Whether a value is or contains a mapping that is no matrix (numbers under ``data``)."""
    if isinstance(value, Mapping):
        return "data" not in value or _hides_groups(value["data"])
    return isinstance(value, list) and any(
        isinstance(part, Mapping) or _hides_groups(part) for part in value
    )


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
