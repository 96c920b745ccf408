"""The exponential and the logarithm of the loops against those of NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.compile import kernel
from farpoint._kernels.exponential import exp_and_eighth, lane_log


@kernel
def exponentials(x: np.ndarray, whole: np.ndarray, eighth: np.ndarray) -> None:
    for i in range(len(x)):
        whole[i], eighth[i] = exp_and_eighth(x[i])


@kernel
def logarithms(x: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(x)):
        out[i] = lane_log(x[i])


def exponentials_of(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    whole, eighth = np.full((2, len(x)), np.nan)
    exponentials(x, whole, eighth)
    return whole, eighth


def test_the_exponential_and_its_eighth_root():
    x = np.r_[0.0, np.geomspace(1e-12, 20.0, 400)]
    whole, eighth = exponentials_of(x)
    np.testing.assert_allclose(whole, np.exp(-x), rtol=1e-9)
    np.testing.assert_allclose(eighth, np.exp(-x / 8), rtol=1e-10)


def test_what_is_next_to_nothing_stays_there():
    whole, eighth = exponentials_of(np.array([20.0, 60.0, 240.0, 1e6, np.inf]))
    assert (np.diff(whole) <= 0.0).all()
    assert (whole > 0.0).all()
    assert whole[2] < 1e-90
    assert whole[2] == whole[3] == whole[4]
    assert eighth[4] == pytest.approx(np.exp(-30.0), rel=1e-6)


def test_the_logarithm_of_any_normal_number():
    rng = np.random.default_rng(0)
    x = np.r_[
        1.0, 2.0, 0.5, np.nextafter(1.0, 0.0), 1e-300, 1e300, np.exp(rng.uniform(-690, 690, 500))
    ]
    out = np.full(len(x), np.nan)
    logarithms(x, out)
    np.testing.assert_allclose(out, np.log(x), rtol=1e-8, atol=1e-8)
