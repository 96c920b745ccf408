"""Result of a general motion: status, covariance, and test of the direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import POSE_PARAMETERS
from farpoint.geometry.so3 import rotation_vector
from farpoint.pose import conclusion
from farpoint.pose.certainty import direction_sigma, fixes_rotation
from farpoint.pose.clustered_outliers import count_clustered_outliers
from farpoint.pose.conclusion import Diagnostics, full_labels
from farpoint.pose.constants import UNOBSERVABLE_NOISE_SHARE
from farpoint.pose.inflation import (
    shared_covariance,
    split_half_ratio,
)
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_motion, is_vague
from farpoint.pose.one_object import is_one_object
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.posterior import Posterior, covariance_between
from farpoint.pose.pure_rotation import PureRotationFit
from farpoint.pose.result import PoseStatus, RelativePose
from farpoint.pose.track_errors import TrackErrors

__all__ = ["conclude_general_motion"]

ONE_OBJECT = (
    "Independently moving object possible: all matches with parallax lie on one compact part of "
    "the image, so a pure rotation and a moving object explain them as well."
)
MOSTLY_NOISE = "Insufficient parallax: the flow beyond the rotation is mostly noise."


def conclude_general_motion(
    matches: Matches,
    posterior: Posterior,
    pure_rotation: Callable[[], PureRotationFit],
    options: RelativePoseOptions,
    diagnostics: Diagnostics,
    errors: TrackErrors,
) -> RelativePose:
    """Result from the likeliest general motion.

    ``pure_rotation`` is called only if the pure rotation is needed.
    """
    rate, fit = options.false_alarm_rate, posterior.fit
    diagnostics.time_stage("refinement_s")
    if not is_motion(fit, rate):
        return conclusion.no_consensus(matches, fit.agreeing, diagnostics)
    fit = count_clustered_outliers(matches, fit, rate)
    posterior = posterior._replace(fit=fit)
    covariance = _inflated_covariance(matches, posterior, options, diagnostics, errors)
    diagnostics.time_stage("covariance_s")
    if not fixes_rotation(covariance[:3, :3]):
        return conclusion.undetermined_rotation(matches, diagnostics)
    diagnostics.cost, diagnostics.sign_probability = fit.cost, fit.sign_probability
    sigma = direction_sigma(covariance)
    labels, noise = full_labels(matches, fit.labels), fit.noise.mean_sigma
    unobservable = _unobservable_direction(posterior, sigma, pure_rotation, rate)
    if unobservable is not None:
        return conclusion.without_direction(
            PoseStatus.ROTATION_ONLY,
            unobservable.reason,
            fit.R_cam1_from_cam0,
            covariance[:3, :3] + unobservable.covariance,
            labels,
            noise,
            diagnostics,
        )
    return conclusion.observed(
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        covariance,
        sigma,
        labels,
        noise,
        diagnostics,
        _ambiguity(posterior),
    )


def _inflated_covariance(
    matches: Matches,
    posterior: Posterior,
    options: RelativePoseOptions,
    diagnostics: Diagnostics,
    errors: TrackErrors,
) -> np.ndarray:
    """Covariance (5, 5), rad^2, inflated for correlated residuals and common errors."""
    ratio = diagnostics.split_half_ratio = split_half_ratio(posterior.fit, options.half_splits)
    inflation = errors.inflation_by_halves(ratio, POSE_PARAMETERS * options.half_splits)
    # Only one of the two is used: both are the effect of the same correlation.
    if matches.design_effect > 1.0:
        inflation *= matches.design_effect
    elif ratio is not None:
        errors = errors.with_pair(ratio, diagnostics.residual_correlation)
        inflation += errors.common_to_halves(options.common_error_slope)
    covariance = inflation * posterior.covariance()
    covariance[:3, :3] += shared_covariance(matches, options.shared_error_px)
    return covariance


class Unobservable(NamedTuple):
    """Why a direction is not observable, and the effect on the rotation.

    Attributes
    ----------
    reason : str
        A sentence for a human reader.
    covariance : ndarray, shape (3, 3)
        Covariance to add to the covariance of the rotation, rad^2.
    """

    reason: str
    covariance: np.ndarray


def _unobservable_direction(
    posterior: Posterior, sigma: float, pure_rotation: Callable[[], PureRotationFit], rate: float
) -> Unobservable | None:
    """Reason why a direction is not observable; None if the direction is observable.

    ``sigma`` is the largest 1-sigma of the direction, rad.
    """
    fit, other = posterior.fit, posterior.alternative
    if other is not None and posterior.has_other_direction:
        ambiguity = _ambiguity(posterior)
        reason = ambiguity if fit.shows_direction else f"{ambiguity} {MOSTLY_NOISE}"
        return Unobservable(reason, other.rotation_covariance_beside(fit))
    if is_one_object(fit.matches.rays0, fit.labels):
        apart = np.array(rotation_vector(pure_rotation().R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))
        return Unobservable(ONE_OBJECT, covariance_between(apart, 0.5))
    vague = is_vague(fit, sigma, rate)
    if fit.shows_direction and not vague:
        return None
    reason = (
        "Insufficient parallax: the direction of the flow beyond the rotation has a 1-sigma of "
        f"{math.degrees(sigma):.0f} deg, and its sign a probability of "
        f"{100 * fit.sign_probability:.0f} %."
        if vague
        else MOSTLY_NOISE
    )
    apart = np.array(rotation_vector(pure_rotation().R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))
    return Unobservable(reason, covariance_between(apart, UNOBSERVABLE_NOISE_SHARE**2))


def _ambiguity(posterior: Posterior) -> str:
    """A sentence about the alternative motion, if there is one."""
    other = posterior.alternative
    return "" if other is None else other.described_beside(posterior.fit)
