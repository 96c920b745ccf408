"""The closed form of Burschka and Mair (2008), with a covariance.

The rotation aligns the rays of the far points (least squares), and the direction is the mean of the
pairwise intersections of derotated flow. The covariance of the rotation comes from the residuals of
the far rays, the covariance of the direction from the jackknife over matches. The closed form uses
no likelihood, and serves as the baseline for the refined estimate.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.search import search_direction
from farpoint.pose import conclusion
from farpoint.pose.certainty import fixes_rotation, largest_sigma
from farpoint.pose.conclusion import Diagnostics, label_matches
from farpoint.pose.constants import DIRECTION_SAMPLES, MAX_EPIPOLE_SIGMA
from farpoint.pose.epipole import mean_epipole
from farpoint.pose.far_rotation import FarRotation
from farpoint.pose.information import positive, symmetric_inverse
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_consensus, is_static
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import PoseStatus, RelativePose

__all__ = ["estimate_closed_form"]


def estimate_closed_form(
    matches: Matches,
    rotation: FarRotation,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
    diagnostics: Diagnostics,
) -> RelativePose:
    """Estimate the rotation from the far rays, then the direction from the near points' flow."""
    diagnostics.iterations = rotation.iterations
    R, far = rotation.R_cam1_from_cam0, rotation.consistent
    area_share = np.pi / 4.0 * (tolerance / matches.outlier_half_width) ** 2
    agreeing = int(np.count_nonzero(far))
    if not is_consensus(agreeing, len(matches), 3, area_share, options.false_alarm_rate):
        return conclusion.no_consensus(matches, agreeing, diagnostics)
    rotation_covariance, sigma = _scatter_of_rotation(matches, R, far)
    if not fixes_rotation(rotation_covariance):
        return conclusion.undetermined_rotation(matches, diagnostics)
    flowing = matches.select(~far)
    agree = _flowing_to_one_direction(flowing, R, tolerance, state)
    diagnostics.time_stage("search_s")
    epipole = mean_epipole(flowing, R, options.flow_saturation_px, agree)
    chance = 0.5 * tolerance / matches.outlier_half_width
    rate = options.false_alarm_rate
    is_common = is_consensus(int(agree.sum()), len(flowing), 2, chance, rate)
    if epipole is None or not is_common or largest_sigma(epipole.covariance) > MAX_EPIPOLE_SIGMA:
        still = is_static(R, rotation_covariance, rate)
        return conclusion.without_direction(
            PoseStatus.STATIC if still else PoseStatus.ROTATION_ONLY,
            f"No motion: {agreeing} of {len(matches)} matches stand still within the noise."
            if still
            else f"Pure rotation or insufficient parallax: {agreeing} far matches fix the "
            f"rotation, the {len(flowing)} others have no common epipole.",
            R,
            rotation_covariance,
            label_matches(matches, far),
            sigma,
            diagnostics,
        )
    near = np.zeros(len(matches), bool)
    near[~far] = agree
    covariance = np.zeros((5, 5))
    covariance[:3, :3] = rotation_covariance
    covariance[3:, 3:] = epipole.covariance
    diagnostics.time_stage("covariance_s")
    return conclusion.observed(
        R,
        epipole.direction_cam1_from_cam0,
        positive(covariance),
        largest_sigma(epipole.covariance),
        label_matches(matches, far | near, near),
        sigma,
        diagnostics,
    )


def _flowing_to_one_direction(
    flowing: Matches, R: np.ndarray, tolerance: float, state: np.ndarray
) -> np.ndarray:
    """Mask (N,) of the matches that agree with the direction towards which most matches flow."""
    everyone, t = np.arange(len(flowing)), np.empty(3)
    if len(flowing) < 3:
        return np.zeros(len(flowing), bool)
    arguments = flowing.pairs, flowing.weights(), everyone, tolerance, DIRECTION_SAMPLES, state
    search_direction(*arguments, R, t)
    return _consistent_with(flowing, R, t, tolerance)


def _scatter_of_rotation(
    matches: Matches, R: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, float]:
    """Covariance (3, 3), rad^2, of the rotation, and 1-sigma noise of a match per coordinate.

    The residuals of the far rays give the noise.
    """
    rays1, weight = matches.rays1[far], matches.precision[far]
    residual = rays1 - matches.rays0[far] @ R.T
    freedom = max(2 * len(rays1) - 3, 1)
    mean = float(np.sum(weight * np.sum(residual**2, axis=1)) / freedom)
    variance = max(mean, matches.min_variance)
    # d(b - R a) / dtheta = [b]x to first order, and [b]x^T [b]x = I - b b^T.
    information = weight.sum() * np.eye(3) - (rays1.T * weight) @ rays1
    return variance * symmetric_inverse(information), float(np.sqrt(variance))


def _consistent_with(
    matches: Matches, R: np.ndarray, t: np.ndarray, tolerance: float
) -> np.ndarray:
    """Mask (N,) of matches that flow towards ``t``, with a residual within the tolerance."""
    rays1, rotated = matches.rays1, matches.rays0 @ R.T
    across = np.einsum("ni,ni->n", rays1, np.cross(t, rotated))
    length = np.linalg.norm(np.cross(t, rotated), axis=1)
    # A ray at the epipole lies on every great circle through the epipole: the residual is 0.
    residual = np.abs(across) / np.maximum(length, 1e-300) * np.sqrt(matches.precision)
    return (residual <= tolerance) & ((rays1 - rotated) @ t > 0.0)
