"""Exponential and logarithm of the kernels against NumPy."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.exponential import exp_and_roots, lane_log


@kernel
def exponentials(x: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(x)):
        out[0, i], out[1, i], out[2, i], out[3, i] = exp_and_roots(x[i])


@kernel
def logarithms(x: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(x)):
        out[i] = lane_log(x[i])


def exponentials_of(x: np.ndarray) -> np.ndarray:
    out = np.full((4, len(x)), np.nan)
    exponentials(x, out)
    return out


def test_the_exponential_and_its_roots():
    x = np.r_[0.0, np.geomspace(1e-12, 300.0, 400)]
    for found, power in zip(exponentials_of(x), (1.0, 8.0, 64.0, 512.0), strict=True):
        np.testing.assert_allclose(found, np.exp(-x / power), rtol=1e-9)


def test_the_last_root_of_what_is_nothing():
    x = np.geomspace(300.0, 15000.0, 100)
    np.testing.assert_allclose(exponentials_of(x)[3], np.exp(-x / 512.0), rtol=1e-4)


def test_what_is_next_to_nothing_stays_there():
    found = exponentials_of(np.array([20.0, 300.0, 15360.0, 1e6, np.inf]))
    assert (np.diff(found) <= 0.0).all()
    np.testing.assert_array_equal(found[:, 2:], found[:, 2:3].repeat(3, axis=1))
    assert (found[:, 4] < [1e-300, 1e-300, 1e-100, 1e-12]).all()


def test_the_logarithm_of_any_normal_number():
    rng = np.random.default_rng(0)
    x = np.r_[
        1.0, 2.0, 0.5, np.nextafter(1.0, 0.0), 1e-300, 1e300, np.exp(rng.uniform(-690, 690, 500))
    ]
    out = np.full(len(x), np.nan)
    logarithms(x, out)
    np.testing.assert_allclose(out, np.log(x), rtol=1e-8, atol=1e-8)
