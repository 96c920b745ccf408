"""Noise of rounded coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.constants import GRID_SIGMA, MIN_SHARE
from farpoint._kernels.rounding import rounding_variance


def points(seed: int, count: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 640.0, (count, 2))


@pytest.mark.parametrize("step", [1.0, 0.5, 0.25])
def test_the_coarsest_grid_gives_the_variance_of_rounding(step):
    first, second = (step * np.round(points(seed) / step) for seed in (1, 2))
    assert rounding_variance(first, second) == pytest.approx((GRID_SIGMA * step) ** 2)


def test_those_found_between_pixels_keep_to_none():
    assert rounding_variance(points(1), points(2)) == 0.0
    # Corners on whole pixels that were tracked to sub-pixel positions are rounded in one image
    # only.
    assert rounding_variance(np.round(points(1)), points(2)) == 0.0
    assert rounding_variance(np.round(points(1), 1), points(2)) == 0.0
    none = np.empty((0, 2))
    assert rounding_variance(none, none) == 0.0


@pytest.mark.parametrize("by_chance", [True, False])
def test_a_tenth_of_them_on_a_grid_is_enough(by_chance):
    first, second = points(1), points(2)
    few = round(MIN_SHARE * len(first)) + (0 if by_chance else 1)
    first[:few], second[:few] = np.round(first[:few]), np.round(second[:few])
    assert rounding_variance(first, second) == (0.0 if by_chance else GRID_SIGMA**2)
