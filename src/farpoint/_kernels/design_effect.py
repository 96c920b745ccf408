"""Design effect of residuals that are correlated within parts of the image."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    CORRELATED_Z,
    IMAGE_PARTS,
    IMAGE_SPLITS,
    MAX_NEIGHBOUR_QUERIES,
    MIN_CORRELATED_MATCHES,
    POSE_PARAMETERS,
)
from farpoint._kernels.image_parts import split_image
from farpoint._kernels.pairs import address, ray0
from farpoint._kernels.residual_correlation import bounded, neighbour_correlation

__all__ = ["correlation_and_design_effect", "design_effect"]


@kernel
def correlation_and_design_effect(
    pairs: np.ndarray, residual: np.ndarray, inlier: np.ndarray, count: int, sigma: float
) -> tuple[float, float, float]:
    """Correlation of neighbouring inlier residuals, z-score of this correlation, `design_effect`.

    The correlation is that of `residual_correlation.neighbour_correlation`. The z-score is the
    correlation times the square root of the number of inliers that were compared with a neighbour.
    With fewer than `MIN_CORRELATED_MATCHES` inliers the results are 0, 0 and 1. The design effect
    is 1 if the z-score is below `CORRELATED_Z`.
    """
    rows = _right(inlier, count)
    if rows.size < MIN_CORRELATED_MATCHES:
        return 0.0, 0.0, 1.0
    correlation = neighbour_correlation(pairs, residual, rows, sigma, MAX_NEIGHBOUR_QUERIES)
    correlation_z = math.sqrt(min(rows.size, MAX_NEIGHBOUR_QUERIES)) * correlation
    if correlation_z < CORRELATED_Z:
        return correlation, correlation_z, 1.0
    return correlation, correlation_z, design_effect(pairs, residual, rows, sigma)


@step_kernel
def _right(inlier: np.ndarray, count: int) -> np.ndarray:
    """Indices of the inliers."""
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
    """Variance of sums of residuals, divided by that of independent residuals (Kish's deff).

    The image is divided into 16 parts, of which p contain matches. S is the sum of the n residuals
    of a part, each divided by ``sigma`` and clipped to +-`GATE_SIGMA`. If residuals are
    independent, the sum of ``S^2 / n`` over the p parts has the expectation ``p - 5`` times the
    mean squared residual, because the pose has 5 degrees of freedom. The result is the sum divided
    by this expectation (Kish, "Survey Sampling", 1965), or 1 if p is at most 5. Only the matches in
    ``rows`` count.
    """
    parts, sums, sizes = _parts(pairs, rows), np.empty(IMAGE_PARTS), np.empty(IMAGE_PARTS)
    clear(sums)
    clear(sizes)
    square = 0.0
    for k in range(rows.size):
        own = bounded(residual[int(rows[k])], sigma)
        sums[parts[k]] += own
        sizes[parts[k]] += 1.0
        square += own * own
    scatter, used = 0.0, 0.0
    for part in range(IMAGE_PARTS):
        if sizes[part] > 0.0:
            scatter += sums[part] * sums[part] / sizes[part]
            used += 1.0
    if not (square > 0.0 and used > POSE_PARAMETERS):
        return 1.0
    return scatter * rows.size / (square * (used - POSE_PARAMETERS))


@step_kernel
def _parts(pairs: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """For each match, the part of the image that contains its ray in camera 0."""
    rays, parts = np.empty(3 * rows.size), np.empty(rows.size, np.int64)
    for k in range(rows.size):
        ray = ray0(pairs, address(rows[k]))
        for i in range(3):
            rays[3 * k + i] = ray[i]
    split_image(rays, IMAGE_SPLITS, parts)
    return parts
