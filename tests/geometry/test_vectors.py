"""Arithmetic of small vectors, compared with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.geometry.vectors import cross, median, products, solutions

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 701])
def test_median(count):
    values = RNG.normal(size=count)
    assert median(values) == np.median(values)


def test_products_and_solutions():
    a, b, v = RNG.normal(size=(9, 2, 3)), RNG.normal(size=(9, 3, 2)), RNG.normal(size=(9, 2))
    np.testing.assert_allclose(products(a, b), a @ b, atol=1e-14)
    np.testing.assert_allclose(
        solutions(a @ b, v), np.linalg.solve(a @ b, v[:, :, None])[:, :, 0], atol=1e-9
    )
    np.testing.assert_allclose(cross(a, a[::-1]), np.cross(a, a[::-1]), atol=1e-14)
