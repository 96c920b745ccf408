"""Whether matches were found on a grid of pixels, as corner detectors and video codecs do."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel

__all__ = ["rounding_variance"]

# If so many matches keep to a grid in both images, all were rounded: detectors round the others to
# the coarser grids of their pyramids. None of what was measured between pixels keeps to any.
MIN_ON_GRID = 0.1
# Whole, half and quarter pixels.
GRIDS = np.int64(3)
# Of the noise of a coordinate, over the step of the grid. The distance between two rounded places
# is up to a step off. Were less noise believed, those that have jumped to the next pixel would be
# wrong matches, and all that have not would know to a thousandth of one that they stand still.
SIGMA = 0.5


@kernel
def rounding_variance(points0: np.ndarray, points1: np.ndarray) -> float:
    """Least variance, px^2, of the coordinates of matches (N, 2) that were rounded; 0 if none were.

    By the coarsest of the grids that at least a tenth of them keep to in both images.
    """
    step = 1.0
    for _ in range(GRIDS):
        kept = 0
        for i in range(len(points0)):
            kept += 1 if _is_on_grid(points0, i, step) and _is_on_grid(points1, i, step) else 0
        if kept > MIN_ON_GRID * len(points0):
            return SIGMA * SIGMA * step * step
        step *= 0.5
    return 0.0


@inner_kernel
def _is_on_grid(points: np.ndarray, i: int, step: float) -> bool:
    x, y = points[i, 0] / step, points[i, 1] / step
    return x == math.floor(x) and y == math.floor(y)
