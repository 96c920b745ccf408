"""Noise of rounded coordinates; corner detectors and video codecs round coordinates to a grid."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.constants import GRID_SIGMA, MIN_SHARE, PIXEL_GRIDS

__all__ = ["rounding_variance"]


@kernel
def rounding_variance(points0: np.ndarray, points1: np.ndarray) -> float:
    """Lower bound of the noise variance of rounded coordinates (N, 2), px^2; 0 without rounding.

    The bound is ``(GRID_SIGMA step)^2``. The step is that of the coarsest grid on which more than
    10 % of the matches lie in both images.
    """
    step = 1.0
    for _ in range(PIXEL_GRIDS):
        kept = 0
        for i in range(len(points0)):
            kept += 1 if _is_on_grid(points0, i, step) and _is_on_grid(points1, i, step) else 0
        if kept > MIN_SHARE * len(points0):
            return GRID_SIGMA * GRID_SIGMA * step * step
        step *= 0.5
    return 0.0


@inner_kernel
def _is_on_grid(points: np.ndarray, i: int, step: float) -> bool:
    x, y = points[i, 0] / step, points[i, 1] / step
    return x == math.floor(x) and y == math.floor(y)
