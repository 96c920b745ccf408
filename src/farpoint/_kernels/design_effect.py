"""How much of their errors matches share: those of one part of the image, added up."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.pairs import address, ray0
from farpoint._kernels.patches import split_image
from farpoint._kernels.residual_correlation import bounded, patch_correlation

__all__ = ["CORRELATED_Z", "MAX_QUERIED", "PARTS", "correlation_and_design_effect", "design_effect"]

# Right matches that are asked for their neighbour, at the most. Fewer cannot show anything.
MAX_QUERIED, MIN_MATCHES = 400, 50
# Correlation of neighbours' residuals, over the root of how many are asked, from which on they are
# likely to be no noise: that of noise is 1.1 over that root, and exceeds this once in a hundred.
CORRELATED_Z = 2.5

# The image is split in two, and each part again, as often as this.
SPLITS = np.int64(4)
PARTS = 2 ** int(SPLITS)
# Degrees of freedom of the residuals that the pose has taken.
POSE_DEGREES = 5.0


@kernel
def correlation_and_design_effect(
    pairs: np.ndarray, residual: np.ndarray, inlier: np.ndarray, count: int, sigma: float
) -> tuple[float, float, float]:
    """The `patch_correlation` of right matches, that over what noise would have, and the `design_effect`.

    Two of the same point, which a detector of features finds again and again, are neighbours, and
    err alike, too. Of few matches, 0 and 0. The last is 1 where they are not likely to be alike.
    """
    rows = _right(inlier, count)
    if rows.size < MIN_MATCHES:
        return 0.0, 0.0, 1.0
    correlation = patch_correlation(
        pairs, residual, rows, _each_by_itself(count), sigma, MAX_QUERIED
    )
    correlation_z = math.sqrt(min(rows.size, MAX_QUERIED)) * correlation
    if correlation_z < CORRELATED_Z:
        return correlation, correlation_z, 1.0
    return correlation, correlation_z, design_effect(pairs, residual, rows, sigma)


@step_kernel
def _each_by_itself(count: int) -> np.ndarray:
    """A patch for each match."""
    patch = np.empty(count, np.int64)
    for i in range(count):
        patch[i] = i
    return patch


@step_kernel
def _right(inlier: np.ndarray, count: int) -> np.ndarray:
    """Rows of the right matches."""
    total = 0
    for i in range(count):
        total += 1 if inlier[i] > 0.5 else 0
    rows, taken = np.empty(total, np.int64), 0
    for i in range(count):
        if inlier[i] > 0.5:
            rows[taken] = i
            taken += 1
    return rows


@inner_kernel
def design_effect(pairs: np.ndarray, residual: np.ndarray, rows: np.ndarray, sigma: float) -> float:
    """How many times larger the variance of a sum is than of residuals that are independent.

    Of the matches in these ``rows``, as the residuals add up over 16 parts of the image (Kish,
    "Survey Sampling", 1965): ``sum S^2 / n`` over the parts, with S the sum of n residuals, has 16
    of the mean square, less five that the pose has taken, if each is by itself.
    """
    parts, sums, sizes = _parts(pairs, rows), np.empty(PARTS), np.empty(PARTS)
    clear(sums)
    clear(sizes)
    square = 0.0
    for k in range(rows.size):
        own = bounded(residual[int(rows[k])], sigma)
        sums[parts[k]] += own
        sizes[parts[k]] += 1.0
        square += own * own
    scatter, used = 0.0, 0.0
    for part in range(PARTS):
        if sizes[part] > 0.0:
            scatter += sums[part] * sums[part] / sizes[part]
            used += 1.0
    if not (square > 0.0 and used > POSE_DEGREES):
        return 1.0
    return scatter * rows.size / (square * (used - POSE_DEGREES))


@step_kernel
def _parts(pairs: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The part of each match, by its ray in camera 0."""
    rays, parts = np.empty(3 * rows.size), np.empty(rows.size, np.int64)
    for k in range(rows.size):
        ray = ray0(pairs, address(rows[k]))
        for i in range(3):
            rays[3 * k + i] = ray[i]
    split_image(rays, SPLITS, parts)
    return parts
