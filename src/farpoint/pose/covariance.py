"""Covariance of rotation and direction, and factors on the covariance for correlated residuals."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.constants import (
    GATE_SIGMA,
    MAX_NEIGHBOUR_QUERIES,
    MAX_SPLIT_RATIO,
    MIN_MATCHES,
)
from farpoint._kernels.covariance import covariance_around
from farpoint._kernels.patches import split_patches
from farpoint._kernels.residual_correlation import patch_correlation
from farpoint._kernels.split_halves import pose_difference_ratio
from farpoint.geometry.so3 import rotation_vector
from farpoint.geometry.vectors import median
from farpoint.pose.certainty import fixes_rotation
from farpoint.pose.constants import (
    EXPECTED_RATIO_FREEDOM,
    HALVES_CORRELATION,
    HALVES_CORRELATION_SLOPE,
    INDEPENDENT_SPLIT_RATIO,
    LINEAR_DIRECTION_SIGMA,
    MAX_COMPRESSION_EXCESS,
    MAX_RATIO_OVER_MEAN,
    MIN_SPLIT_MATCHES,
    UNCOMPRESSED_SPLIT_RATIO,
)
from farpoint.pose.general_motion import GeneralMotionFit, linearisation_point, packed_pose
from farpoint.pose.information import positive
from farpoint.pose.matches import Matches
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.patches import patches_of
from farpoint.pose.pure_rotation import PureRotationFit, fit_pure_rotation
from farpoint.pose.small import size2

__all__ = [
    "general_motion_covariance",
    "inflation_between_patches",
    "inflation_beyond_patches",
    "inflation_by_halves",
    "mean_split_half_ratio",
    "shared_covariance",
    "split_half_ratio",
    "split_half_ratio_of_rotation",
]


def general_motion_covariance(fit: GeneralMotionFit) -> np.ndarray:
    """Covariance (5, 5) of ``[dtheta, dbeta]``, rad^2, in the `tangent_basis` of the direction.

    The covariance is the sandwich ``H^-1 V H^-1``. H is the Hessian of the expected negative log
    likelihood, and V is the variance of the gradient. H is the Gauss-Newton matrix minus a
    correction: because the depths are also estimated, noise in the flow increases the Gauss-Newton
    matrix like true flow. V is a weighted mean of two matrices: the Gauss-Newton matrix, which is
    correct if the noise model is true, and the scatter of the gradient over the matches, which is
    correct for any noise. The weight of the scatter increases with the effective number of matches.

    If the direction is uncertain, H depends on the pose: a small error of the rotation lengthens
    the flow of all matches and increases the information. If the root of the sum of the variances
    of the direction exceeds `LINEAR_DIRECTION_SIGMA`, the covariance is therefore averaged over the
    poses within one sigma.
    """
    covariance = fit.covariance
    if LINEAR_DIRECTION_SIGMA**2 < covariance[3, 3] + covariance[4, 4] < math.inf:
        covariance = _averaged(fit, covariance)
    return positive(covariance)


def split_half_ratio(fit: GeneralMotionFit, splits: int) -> float | None:
    """Squared difference of the poses from two halves of the matches, divided by its expectation.

    If tracks of one surface have correlated errors, the poses from two halves differ by more than
    the covariances of the poses predict (delete-d jackknife: Shao and Wu, Ann. Stat. 17, 1989, DOI
    10.1214/aos/1176347263). All matches of an image patch are in the same half, because
    neighbouring matches are not independent (Künsch, Ann. Stat. 17, 1989, DOI
    10.1214/aos/1176347265). The result is the mean over random ``splits``, divided by the ratio of
    independent noise, `INDEPENDENT_SPLIT_RATIO`. It is None without splits, for fewer than
    `MIN_SPLIT_MATCHES` matches, and for a fit with an infinite covariance.
    """
    matches = fit.matches
    if not _can_split(matches, splits) or not math.isfinite(fit.covariance[0, 0]):
        return None
    state = np.zeros(1, np.uint64)
    packed = matches.packed(fit.per_match[0], soft_cheirality=True)
    inliers, patch = float(np.add.reduce(fit.probability)), patches_of(matches.rays0)
    pose, is_shrunk = packed_pose(fit), fit.has_shrunk_flow
    return (
        pose_difference_ratio(packed, pose, inliers, is_shrunk, splits, patch, state)
        / INDEPENDENT_SPLIT_RATIO
    )


def split_half_ratio_of_rotation(
    matches: Matches, fit: PureRotationFit, splits: int
) -> float | None:
    """`split_half_ratio` for a pure rotation, not divided by `INDEPENDENT_SPLIT_RATIO`.

    A split is left out if one of the halves determines no rotation. The result is 1 if all splits
    are left out.
    """
    if not _can_split(matches, splits):
        return None
    n, patch, tolerance = len(matches), patches_of(matches.rays0), GATE_SIGMA * fit.noise.sigma
    state, half, squares = np.zeros(1, np.uint64), np.empty(n, np.int64), []
    for _ in range(splits):
        if not MIN_MATCHES <= split_patches(patch, state, half) <= n - MIN_MATCHES:
            continue
        one, other = (
            fit_pure_rotation(matches.select(half == k), fit.R_cam1_from_cam0, tolerance)
            for k in (0, 1)
        )
        expected = one.covariance + other.covariance
        if fixes_rotation(expected):
            apart = rotation_vector(one.R_cam1_from_cam0 @ other.R_cam1_from_cam0.T)
            squares.append(min(size2(apart, expected) / 3.0, MAX_SPLIT_RATIO))
    return float(np.mean(squares)) if squares else 1.0


def _can_split(matches: Matches, splits: int) -> bool:
    """Whether splits are requested and there are enough matches."""
    return splits > 0 and len(matches) >= MIN_SPLIT_MATCHES


def inflation_by_halves(ratio: float | None, expected: float, freedom: int) -> float:
    """Factor on the covariance: mean of the measured and the expected split-half ratio.

    The two ratios are weighted by degrees of freedom. ``freedom`` is the number of degrees of
    freedom of the measured ratio, summed over all splits.
    """
    if ratio is None:
        return expected
    return (EXPECTED_RATIO_FREEDOM * expected + freedom * ratio) / (
        EXPECTED_RATIO_FREEDOM + freedom
    )


def mean_split_half_ratio(ratio: float | None, expected: float, pairs: int) -> float:
    """Mean split-half ratio of this pair of views and of ``pairs`` earlier pairs.

    ``ratio`` is the `split_half_ratio` of this pair: the squared difference of the poses from two
    halves of the matches, divided by its expectation. ``expected`` is the mean ratio of the earlier
    pairs. Before it enters the mean, ``ratio`` is limited to `MAX_RATIO_OVER_MEAN` times
    ``expected``.
    """
    if ratio is None:
        return expected
    return expected + (min(ratio, MAX_RATIO_OVER_MEAN * expected) - expected) / (pairs + 1)


def inflation_beyond_patches(ratio: float | None, options: RelativePoseOptions) -> float:
    """Factor on the covariance for errors that are correlated beyond a patch.

    Both halves of the matches have such errors in common, and common errors cancel in the
    difference between the halves. Errors of a video codec are correlated over all lengths, from a
    block to the image. The variance that cancels is taken as proportional to the excess of the
    split-half ratio over 1.08, the upper bound for uncompressed video. The factor is
    ``1 + slope * min(mean - 1.08, 1)``, at least 1. ``slope`` is
    ``options.sharing_beyond_patches``. ``mean`` is the `mean_split_half_ratio`, because the ratio
    of one pair has a large sampling error.
    """
    expected, pairs = options.expected_half_ratio, options.expected_half_ratio_pairs
    excess = mean_split_half_ratio(ratio, expected, pairs) - UNCOMPRESSED_SPLIT_RATIO
    return 1.0 + options.sharing_beyond_patches * min(max(excess, 0.0), MAX_COMPRESSION_EXCESS)


def inflation_between_patches(fit: GeneralMotionFit) -> float:
    """Factor on the covariance for correlated residuals of neighbouring patches.

    If surfaces of the scene are consistent with different motions, the likelihood has several
    modes. The poses from both halves are refined from the same mode and stay near this mode, but
    other matches of the same scene might lead to another mode. The split-half ratio does not
    contain this uncertainty. The factor is
    ``1 + HALVES_CORRELATION_SLOPE * max(c - HALVES_CORRELATION, 0)`` with the correlation c of
    residuals in neighbouring patches.
    """
    matches, inlier = fit.matches, np.flatnonzero(fit.probability > 0.5)
    patch = patches_of(matches.rays0)
    correlation = patch_correlation(
        matches.pairs, fit.residual, inlier, patch, fit.noise.sigma, MAX_NEIGHBOUR_QUERIES
    )
    return 1.0 + HALVES_CORRELATION_SLOPE * max(correlation - HALVES_CORRELATION, 0.0)


def _averaged(fit: GeneralMotionFit, covariance: np.ndarray) -> np.ndarray:
    """Mean of the covariance over the poses within one sigma of the given covariance."""
    averaged, inliers = np.empty((5, 5)), float(np.add.reduce(fit.probability))
    matches = fit.matches
    point = linearisation_point(fit, matches.outlier_half_width, matches.pairs, fit.per_match[0])
    covariance_around(point, inliers, fit.has_shrunk_flow, covariance, averaged)
    return averaged


def shared_covariance(matches: Matches, sigma: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of the rotation due to an error that is common to all matches.

    ``sigma`` is the 1-sigma of the displacement of a typical match by the common error, in the unit
    of the noise sigma (px, or ``noise_rad`` if the user gave rays).
    """
    if sigma == 0.0:
        return np.zeros((3, 3))
    per_unit = 0.5 * median(1.0 / matches.precision)  # rad^2; both images have noise
    return sigma**2 * per_unit * np.eye(3)
