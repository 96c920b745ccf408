"""Numbers that a user gives as options, by every record of options that checks them."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive


@dataclass(frozen=True)
class Sample:
    share: object = 0.5
    length: object = 1.0
    count: object = 3

    def __post_init__(self) -> None:
        coerce_float(self, "a share, 0 to 1", lambda share: 0 <= share <= 1, "share")
        coerce_positive(self, "length")
        coerce_int(self, 2, "count")


@pytest.mark.parametrize("value", [1, np.float32(0.25), np.int64(1), Fraction(1, 4), 0.75])
def test_a_number_of_any_kind_becomes_a_float(value: object):
    settled = Sample(share=value).share
    assert type(settled) is float
    assert settled == value


@pytest.mark.parametrize("value", [7, np.int32(7), np.uint8(7)])
def test_a_whole_number_of_any_kind_becomes_an_int(value: object):
    settled = Sample(count=value).count
    assert type(settled) is int
    assert settled == 7


@pytest.mark.parametrize(
    ("name", "expected", "values"),
    [
        ("share", "a share, 0 to 1", (-0.1, 1.1, np.nan, True, "0.5", None, 0.5j, [0.5])),
        ("length", "a positive number", (0.0, -1, np.inf, np.nan, 10**400, np.float64(-np.inf))),
        ("count", "a whole number, 2 or more", (1, 3.0, True, np.float32(3.0), 10**400, "3", None)),
    ],
)
def test_a_fault_names_the_field_and_what_was_expected(name: str, expected: str, values: tuple):
    for value in values:
        with pytest.raises(InputError, match=f"^{name}: expected {expected}, got ") as caught:
            Sample(**{name: value})
        assert caught.value.field == name
