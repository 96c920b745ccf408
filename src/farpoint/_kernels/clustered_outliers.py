"""Outliers that are clustered in the image: their density near each match.

Outliers lie on a moving object, on a reflection, or on repeated structure. Some matches of such a
cluster agree with the motion by chance. The other matches in the same part of the image tell that
they are outliers, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.constants import GATE_SIGMA, MIN_MATCHES, UNIFORM_COUNT
from farpoint._kernels.exponential import exp_and_roots, lane_log
from farpoint._kernels.image_parts import split_image
from farpoint._kernels.mixture import clutter_at, clutter_of
from farpoint._kernels.pairs import address, ray0

__all__ = ["odds_by_parts"]


class _Parts(NamedTuple):
    """Sums over the matches in each part of the image."""

    sizes: np.ndarray
    """Number of matches."""
    outliers: np.ndarray
    """Sum of the outlier probabilities."""
    squares: np.ndarray
    """Sum of the squared residuals, multiplied by the outlier probabilities."""


@kernel
def odds_by_parts(
    pairs: np.ndarray,
    inlier: np.ndarray,
    residual: np.ndarray,
    mixture: np.ndarray,
    half_width: float,
    odds: np.ndarray,
) -> float:
    """Odds of each match by the other matches in its part of the image, and what the parts explain.

    Each part contains about 8 to 16 matches (`MIN_MATCHES`). I and O are the sums of the inlier and
    of the outlier probabilities of the other matches in the part of a match, and e is the share of
    outliers among all matches. With half a match that is like all matches, the odds of the match to
    be an inlier are ``(I + (1 - e) / 2) / (O half_width / h + e / 2)``: the outliers in the part
    lie in a strip with the half-width ``h = sqrt(3) s``, where s is the root mean square of their
    residuals.

    The log likelihood is that of normally distributed residuals of the outliers in the part, with
    sigma s. The likelihood is proper, and a match does not count in its own part. Parts are
    therefore less likely than no parts if the outliers are not clustered.

    Parameters
    ----------
    pairs : ndarray
        Panels of the N matches.
    inlier, residual : ndarray, shape (N,)
        Inlier probabilities and Sampson residuals of a motion.
    mixture : ndarray, shape (4,)
        Noise parameters of the motion; see `pose.Pose`.
    half_width : float
        Half-width of the strip of all outliers.
    odds : ndarray, shape (N,)
        Receives the odds of each match, divided by the odds ``(1 - e) / e`` of all matches.

    Returns
    -------
    float
        Log-likelihood ratio of the parts to no parts.
    """
    count, share, splits = odds.size, mixture[1], 0
    while count >> (splits + 1) >= MIN_MATCHES:
        splits += 1
    part, parts = np.empty(count, np.int64), 1 << splits
    _split(pairs, splits, part)
    sums = _Parts(np.empty(parts), np.empty(parts), np.empty(parts))
    _sum_by_parts(part, inlier, residual, sums)
    clutter, least = clutter_of(mixture, half_width), GATE_SIGMA * GATE_SIGMA * mixture[0]
    # Factor from `clutter_at` to the density of outliers times their share.
    scale = (1.0 - share) / math.sqrt(2.0 * math.pi * mixture[0])
    log_ratio = 0.0
    for i in range(count):
        k, outlier, square = part[i], 1.0 - inlier[i], residual[i] * residual[i]
        outliers = sums.outliers[k] - outlier
        inliers = sums.sizes[k] - 1.0 - outliers + UNIFORM_COUNT * (1.0 - share)
        total = sums.sizes[k] - 1.0 + UNIFORM_COUNT
        variance = max((sums.squares[k] - outlier * square) / max(outliers, 1e-300), least)
        around, _ = clutter_at(clutter, residual[i])
        near = outliers * _normal(square, variance) / (scale * around) + UNIFORM_COUNT
        log_ratio += lane_log((inlier[i] * inliers / (1.0 - share) + outlier * near) / total)
        denser = max(half_width / math.sqrt(3.0 * variance), 1.0)
        odds[i] = inliers / (outliers * denser + UNIFORM_COUNT * share) * share / (1.0 - share)
    return log_ratio


@step_kernel
def _split(pairs: np.ndarray, splits: int, part: np.ndarray) -> None:
    """Part of image 0 (`split_image`) that contains each match."""
    rays = np.empty(3 * part.size)
    for i in range(part.size):
        rays[3 * i], rays[3 * i + 1], rays[3 * i + 2] = ray0(pairs, address(i))
    split_image(rays, splits, part)


@step_kernel
def _sum_by_parts(part: np.ndarray, inlier: np.ndarray, residual: np.ndarray, sums: _Parts) -> None:
    clear(sums.sizes)
    clear(sums.outliers)
    clear(sums.squares)
    for i in range(part.size):
        k, outlier = part[i], 1.0 - inlier[i]
        sums.sizes[k] += 1.0
        sums.outliers[k] += outlier
        sums.squares[k] += outlier * residual[i] * residual[i]


@inlined_kernel
def _normal(square: float, variance: float) -> float:
    """Density of a normal distribution at a value with the given ``square``."""
    whole, _, _, _ = exp_and_roots(0.5 * square / variance)
    return whole / math.sqrt(2.0 * math.pi * variance)
