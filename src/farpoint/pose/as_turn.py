"""Matches that show no translation, concluded as a turn: how sure, and is there any?"""

from __future__ import annotations

import math

import numpy as np

from farpoint.pose import conclusion
from farpoint.pose.certainty import fixes_rotation
from farpoint.pose.conclusion import Course, label_matches
from farpoint.pose.covariance import (
    growth_beyond_patches,
    growth_by_halves,
    half_ratio_of_turn,
    moving_covariance,
    shared_covariance,
)
from farpoint.pose.far_rotation import IDENTITY
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import PoseStatus, RelativePose
from farpoint.pose.small import rotation_vector
from farpoint.pose.turning_fit import TurningFit
from farpoint.pose.verdict import is_consensus, is_static

__all__ = ["conclude_turn"]

# A motion that leaves so much less noise than a rotation may be the truth, be there ever so few
# matches to say so.
FAR_LESS_NOISE = 0.5


def conclude_turn(
    matches: Matches,
    fit: TurningFit,
    moving: MovingFit,
    shown: float,
    options: RelativePoseOptions,
    course: Course,
) -> RelativePose:
    """The rotation fitted. Its covariance holds that of the motion as far as one is ``shown``."""
    sigma, rate = fit.noise.sigma, options.false_alarm_rate
    right = fit.probability > 0.5
    agreeing = int(np.count_nonzero(right))
    chance = math.pi / 4.0 * (3.0 * sigma / matches.spread) ** 2
    if not is_consensus(agreeing, len(matches), 2, chance, rate):
        return conclusion.no_consensus(matches, agreeing, course)
    course.cost = fit.cost
    covariance = _with_all_that_is_shared(matches, fit, options, course)
    stands_still = is_static(fit.R_cam1_from_cam0, covariance, rate)
    if moving.noise.mean_sigma < FAR_LESS_NOISE * fit.noise.mean_sigma:
        shown = 1.0
    if shown > 0.0:
        covariance += shown * _doubt_if_moving(fit, moving)
    if not fixes_rotation(covariance):
        return conclusion.unfixed_rotation(matches, course)
    if stands_still:
        status = PoseStatus.STATIC
        reason = f"{agreeing} of {len(matches)} matches stand still within the noise."
    else:
        status = PoseStatus.ROTATION_ONLY
        reason = (
            f"The camera only turned, or saw nothing near enough: {agreeing} of {len(matches)} "
            "matches move by the rotation alone, within the noise."
        )
    return conclusion.turned(
        status,
        reason,
        fit.R_cam1_from_cam0,
        covariance,
        label_matches(matches, right),
        fit.noise.mean_sigma,
        course,
    )


def _with_all_that_is_shared(
    matches: Matches, fit: TurningFit, options: RelativePoseOptions, course: Course
) -> np.ndarray:
    """Covariance (3, 3), rad^2, grown by what matches have in common."""
    ratio = course.half_ratio = half_ratio_of_turn(matches, fit, options.half_deals)
    growth = growth_by_halves(ratio, options.expected_half_ratio, 3 * options.half_deals)
    if ratio is not None:
        growth *= growth_beyond_patches(ratio, options)
    covariance = matches.sharing * growth * fit.covariance
    return covariance + shared_covariance(matches, options.shared_error_px)


def _doubt_if_moving(fit: TurningFit, moving: MovingFit) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation that may as well be that of a motion.

    About which axis the two differ depends on a direction that is not known.
    """
    apart = rotation_vector(fit.R_cam1_from_cam0 @ moving.R_cam1_from_cam0.T)
    doubt = 0.5 * math.hypot(*apart) ** 2 * IDENTITY
    own = moving.matches.sharing * moving_covariance(moving)[:3, :3]
    return doubt + own if fixes_rotation(own) else doubt
