"""Factors on a covariance for correlated residuals, and the covariance of a shared error."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.constants import (
    GATE_SIGMA,
    MAX_SPLIT_RATIO,
    MIN_MATCHES,
)
from farpoint._kernels.image_parts import split_parts
from farpoint._kernels.split_halves import pose_difference_ratio
from farpoint.geometry.so3 import rotation_vector
from farpoint.geometry.vectors import median
from farpoint.pose.certainty import fixes_rotation
from farpoint.pose.constants import (
    INDEPENDENT_SPLIT_RATIO,
    MIN_SPLIT_MATCHES,
)
from farpoint.pose.general_motion import GeneralMotionFit, packed_pose
from farpoint.pose.image_parts import parts_of
from farpoint.pose.matches import Matches
from farpoint.pose.pure_rotation import PureRotationFit, fit_pure_rotation
from farpoint.pose.small import size2

__all__ = [
    "shared_covariance",
    "split_half_ratio",
    "split_half_ratio_of_rotation",
]


def split_half_ratio(fit: GeneralMotionFit, splits: int) -> float | None:
    """Squared difference of the poses from two halves of the matches, divided by its expectation.

    If tracks of one surface have correlated errors, the poses from two halves differ by more than
    the covariances of the poses predict (delete-d jackknife: Shao and Wu, Ann. Stat. 17, 1989, DOI
    10.1214/aos/1176347263). All matches of one of 16 parts of the image are in the same half,
    because neighbouring matches are not independent (Künsch, Ann. Stat. 17, 1989, DOI
    10.1214/aos/1176347265). The result is the mean over random ``splits``, divided by the ratio of
    independent noise, `INDEPENDENT_SPLIT_RATIO`. It is None without splits, for fewer than
    `MIN_SPLIT_MATCHES` matches, and for a fit with an infinite covariance.
    """
    matches = fit.matches
    if not _can_split(matches, splits) or not math.isfinite(fit.covariance[0, 0]):
        return None
    state = np.zeros(1, np.uint64)
    packed = matches.packed(fit.per_match[0], soft_cheirality=True)
    inliers, part = float(np.add.reduce(fit.probability)), parts_of(matches.rays0)
    pose, is_shrunk = packed_pose(fit), fit.has_shrunk_flow
    return (
        pose_difference_ratio(packed, pose, inliers, is_shrunk, splits, part, state)
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
    n, part, tolerance = len(matches), parts_of(matches.rays0), GATE_SIGMA * fit.noise.sigma
    state, half, squares = np.zeros(1, np.uint64), np.empty(n, np.int64), []
    for _ in range(splits):
        if not MIN_MATCHES <= split_parts(part, state, half) <= n - MIN_MATCHES:
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


def shared_covariance(matches: Matches, sigma: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of the rotation due to an error that is common to all matches.

    ``sigma`` is the 1-sigma of the displacement of a typical match by the common error, in the unit
    of the noise sigma (px, or ``noise_rad`` if the user gave rays).
    """
    if sigma == 0.0:
        return np.zeros((3, 3))
    per_unit = 0.5 * median(1.0 / matches.precision)  # rad^2; both images have noise
    return sigma**2 * per_unit * np.eye(3)
