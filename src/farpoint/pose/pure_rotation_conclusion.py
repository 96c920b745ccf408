"""Result of a pure rotation: whether the camera rotates or is static, and the covariance."""

from __future__ import annotations

import math

import numpy as np

from farpoint.geometry.so3 import rotation_vector
from farpoint.pose import conclusion
from farpoint.pose.certainty import fixes_rotation
from farpoint.pose.conclusion import Diagnostics, label_matches
from farpoint.pose.constants import FAR_LESS_NOISE_RATIO, IDENTITY, ROTATION_PARAMETERS
from farpoint.pose.general_motion import GeneralMotionFit
from farpoint.pose.inflation import (
    shared_covariance,
    split_half_ratio_of_rotation,
)
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_consensus, is_static
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.pure_rotation import PureRotationFit
from farpoint.pose.result import PoseStatus, RelativePose
from farpoint.pose.track_errors import TrackErrors

__all__ = ["conclude_pure_rotation"]


def conclude_pure_rotation(
    matches: Matches,
    fit: PureRotationFit,
    general: GeneralMotionFit,
    evidence: float,
    options: RelativePoseOptions,
    diagnostics: Diagnostics,
    errors: TrackErrors,
) -> RelativePose:
    """Result from the fitted pure rotation.

    The covariance of the result includes the covariance for the case that the general motion is the
    true one, in proportion to the ``evidence`` for the general motion, 0 to 1.
    """
    sigma, rate = fit.noise.sigma, options.false_alarm_rate
    inlier = fit.probability > 0.5
    agreeing = int(np.count_nonzero(inlier))
    chance = math.pi / 4.0 * (3.0 * sigma / matches.outlier_half_width) ** 2
    if not is_consensus(agreeing, len(matches), 2, chance, rate):
        return conclusion.no_consensus(matches, agreeing, diagnostics)
    diagnostics.cost = fit.cost
    covariance = _inflated_covariance(matches, fit, options, diagnostics, errors)
    stands_still = is_static(fit.R_cam1_from_cam0, covariance, rate)
    if general.noise.mean_sigma < FAR_LESS_NOISE_RATIO * fit.noise.mean_sigma:
        evidence = 1.0
    if evidence > 0.0:
        covariance += evidence * _covariance_if_general(fit, general)
    if not fixes_rotation(covariance):
        return conclusion.undetermined_rotation(matches, diagnostics)
    if stands_still:
        status = PoseStatus.STATIC
        reason = f"No motion: {agreeing} of {len(matches)} matches stand still within the noise."
    else:
        status = PoseStatus.ROTATION_ONLY
        reason = (
            f"Pure rotation or no near points: {agreeing} of {len(matches)} matches move by the "
            "rotation alone, within the noise."
        )
    return conclusion.without_direction(
        status,
        reason,
        fit.R_cam1_from_cam0,
        covariance,
        label_matches(matches, inlier),
        fit.noise.mean_sigma,
        diagnostics,
    )


def _inflated_covariance(
    matches: Matches,
    fit: PureRotationFit,
    options: RelativePoseOptions,
    diagnostics: Diagnostics,
    errors: TrackErrors,
) -> np.ndarray:
    """Covariance (3, 3), rad^2, inflated for correlated residuals and common errors."""
    ratio = split_half_ratio_of_rotation(matches, fit, options.half_splits)
    diagnostics.split_half_ratio = ratio
    inflation = errors.inflation_by_halves(ratio, ROTATION_PARAMETERS * options.half_splits)
    if ratio is not None:
        errors = errors.with_pair(ratio, diagnostics.residual_correlation)
        inflation += errors.common_to_halves(options.common_error_slope)
    covariance = matches.design_effect * inflation * fit.covariance
    return covariance + shared_covariance(matches, options.shared_error_px)


def _covariance_if_general(fit: PureRotationFit, general: GeneralMotionFit) -> np.ndarray:
    """Covariance (3, 3), rad^2, of the pure rotation if the general motion is the true one.

    The variance of every axis is 0.5 times the squared angle between both rotations, because the
    axis of the difference depends on the unknown direction. The rotation covariance of the general
    motion is added if the general motion fixes the rotation (`fixes_rotation`).
    """
    apart = rotation_vector(fit.R_cam1_from_cam0 @ general.R_cam1_from_cam0.T)
    isotropic = 0.5 * math.hypot(*apart) ** 2 * IDENTITY
    own = general.matches.design_effect * general.averaged_covariance[:3, :3]
    return isotropic + own if fixes_rotation(own) else isotropic
