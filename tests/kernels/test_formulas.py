"""Formulas mean the same to Python as to the compiler, with the same digits in every loop."""

from __future__ import annotations

import os

import numba
import numpy as np
import pytest

from farpoint._kernels.compile import kernel
from farpoint._kernels.formulas import (
    choose,
    exponent_and_mantissa,
    formula,
    greater,
    lesser,
    root,
    sum_formula,
    with_sign_of,
)
from farpoint._kernels.fused import fused

compiled_only = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"
)


@formula
def every_operation(x, y, i):
    """All that a formula may do with numbers, indices and truth values."""
    part = -x + 2 * y - 3.5 / (1 + y * y) - (4 - x) / 8
    size = abs(part) + root(greater(x, 0.0)) + with_sign_of(x, 2.5) + with_sign_of(-1.0, y)
    inside = (x < y) & (part <= 7.0) | (x > 3.0) & (y >= 2)
    exponent, mantissa = exponent_and_mantissa(size * size + 1e-3)
    whole, rest = (i * 5 + 3) // 4, (7 + i - 2) % 3
    chosen = choose(inside, lesser(part, y), 1), choose(i > 4, whole, rest)
    return (fused(part, 1.5, y), size), chosen, (inside, exponent, mantissa), 2


every_operation_compiled = kernel(lambda x, y, i: every_operation(x, y, i))


@pytest.mark.parametrize("i", [0, 3, 11])
def test_a_formula_is_what_python_makes_of_it(i):
    for x, y in np.random.default_rng(i).normal(scale=3.0, size=(50, 2)).tolist():
        compiled, plain = every_operation_compiled(x, y, i), every_operation(x, y, i)
        np.testing.assert_allclose(compiled[0], plain[0], rtol=1e-14)
        np.testing.assert_allclose(compiled[1], plain[1], rtol=1e-14)
        np.testing.assert_allclose(compiled[2], plain[2], rtol=1e-14)
        assert compiled[3] == plain[3]


def test_a_power_of_two_comes_apart():
    for x, exponent, mantissa in ((1.0, 0, 1.0), (0.75, -1, 1.5), (1e300, 996, 1e300 / 2.0**996)):
        assert exponent_and_mantissa(x) == (exponent, mantissa)


@formula
def swap_and_sum(a, i, j):
    """Exchange two elements of an array; the sum of both before."""
    before = a[i, j] + a[j, i]
    a[i, j], a[j, i] = a[j, i], a[i, j]
    a[0, 0] = 9.0
    return before


@pytest.mark.parametrize(
    "array",
    [
        np.arange(12.0).reshape(3, 4),
        np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        np.arange(48.0).reshape(6, 8)[::2, ::2],
    ],
    ids=["C", "Fortran", "strided"],
)
def test_a_formula_reads_and_writes_arrays_of_any_layout(array):
    @kernel
    def swapped(a, i, j):
        return swap_and_sum(a, i, j)

    expected = array.copy()
    total = swap_and_sum(expected, 1, 2)
    assert swapped(array, 1, 2) == total
    np.testing.assert_array_equal(array, expected)


def test_a_formula_reads_three_axes():
    @formula
    def corner(a, i):
        return a[i, 1, 2]

    @kernel
    def corners(a, i):
        return corner(a, i)

    a = np.arange(24.0).reshape(2, 3, 4)
    assert corners(a, 1) == a[1, 1, 2]


@compiled_only
def test_a_formula_has_no_branches():
    @formula
    def branches(x):
        return x if x > 0.0 else -x

    @numba.njit
    def compiled(x):
        return branches(x)

    with pytest.raises(Exception, match="a formula has no branches"):
        compiled(1.0)


@compiled_only
def test_only_sums_may_be_taken_in_any_order():
    @sum_formula
    def any_order(total, x):
        return total + x * x

    @formula
    def in_order(total, x):
        return total + x * x

    @numba.njit
    def squares(values):
        first = second = 0.0
        for i in range(values.shape[0]):
            first = any_order(first, values[i])
            second = in_order(second, values[i])
        return first, second

    values = np.random.default_rng(1).normal(size=1000)
    first, second = squares(values)
    assert second == sum_in_order(values)
    np.testing.assert_allclose(first, second, rtol=1e-13)
    (code,) = squares.inspect_llvm().values()
    assert "fadd reassoc" in code


def sum_in_order(values):
    total = 0.0
    for x in values.tolist():
        total = total + x * x
    return total
