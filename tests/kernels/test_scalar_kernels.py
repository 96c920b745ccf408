"""One rounding where there would be two, and the same digits in every loop."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from farpoint._kernels.scalars import fma


def test_a_product_is_added():
    @numba.njit
    def compiled(a, b, c):
        return fma(a, b, c)

    for a, b, c in ((2.0, 3.0, 4.0), (-0.5, 8.0, 0.25), (np.inf, 1.0, 0.0)):
        assert fma(a, b, c) == compiled(a, b, c) == a * b + c
    assert np.isnan(compiled(np.nan, 1.0, 0.0))


def test_a_loop_over_several_has_the_digits_of_one():
    @numba.njit
    def sums(a, b, c, out):
        for i in range(a.shape[0]):
            out[i] = fma(a[i], b[i], c[i])

    a, b, c = np.random.default_rng(0).normal(size=(3, 1000))
    together, alone = np.empty(1000), np.empty(1000)
    sums(a, b, c, together)
    for i in range(1000):
        sums(a[i : i + 1], b[i : i + 1], c[i : i + 1], alone[i : i + 1])
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_allclose(together, a * b + c, rtol=0.0, atol=1e-14)


def test_float32_stays_float32():
    compiled = numba.njit(lambda a, b, c: fma(a, b, c))
    a, b, c = (np.float32(value) for value in (0.1, 0.3, -0.7))
    result = compiled(a, b, c)
    assert result == np.float32(result)
    assert result == pytest.approx(float(a) * float(b) + float(c), rel=1e-7)
