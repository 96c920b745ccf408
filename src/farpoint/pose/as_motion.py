"""Matches that show a translation, concluded as a motion: which, how sure, and with a direction?"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint.pose import conclusion
from farpoint.pose.certainty import MAX_DIRECTION_SIGMA, direction_sigma, fixes_rotation
from farpoint.pose.conclusion import Course, given_labels
from farpoint.pose.covariance import (
    growth_between_patches,
    growth_beyond_patches,
    growth_by_halves,
    half_ratio,
    shared_covariance,
)
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit
from farpoint.pose.one_object import is_one_object
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import PoseStatus, RelativePose
from farpoint.pose.rivals import Held, doubt_between, hold_against_rivals, likelier_of_plane
from farpoint.pose.small import rotation_vector
from farpoint.pose.turning_fit import TurningFit
from farpoint.pose.verdict import is_motion

__all__ = ["conclude_motion"]

# Share of a flow too short for a direction that noise makes, about: so far towards that of a turn
# may the rotation be.
SHORT_OF_TURN = 0.5
ONE_OBJECT = (
    "All matches with parallax lie on one compact part of the image: an object that moves before a "
    "camera that only turns explains them as well."
)
MOSTLY_NOISE = "The flow beyond the rotation is too short: most of it is noise."


def conclude_motion(
    matches: Matches,
    fit: MovingFit,
    turned: Callable[[], TurningFit],
    options: RelativePoseOptions,
    course: Course,
) -> RelativePose:
    """The motion fitted, or a rival of it; the matches are fitted as a turn where that is asked."""
    rate = options.false_alarm_rate
    fit, of_plane = likelier_of_plane(fit)
    course.lap("refinement_s")
    if not is_motion(fit, rate):
        return conclusion.no_consensus(matches, fit.agreeing, course)
    held = hold_against_rivals(fit, of_plane, turned, rate)
    fit, covariance = held.fit, _with_all_that_is_shared(matches, held, options, course)
    course.lap("covariance_s")
    if not fixes_rotation(covariance[:3, :3]):
        return conclusion.unfixed_rotation(matches, course)
    course.cost, course.sign_probability = fit.cost, fit.sign_probability
    sigma = direction_sigma(covariance)
    labels, noise = given_labels(matches, fit.labels), fit.noise.mean_sigma
    untold = _untold(held, sigma, turned, rate)
    if untold is not None:
        return conclusion.turned(
            PoseStatus.ROTATION_ONLY,
            untold.because,
            fit.R_cam1_from_cam0,
            covariance[:3, :3] + untold.doubt,
            labels,
            noise,
            course,
        )
    return conclusion.observed(
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        covariance,
        sigma,
        labels,
        noise,
        course,
        _beside(held),
    )


def _with_all_that_is_shared(
    matches: Matches, held: Held, options: RelativePoseOptions, course: Course
) -> np.ndarray:
    """Covariance (5, 5), rad^2, grown by what matches have in common."""
    ratio = course.half_ratio = half_ratio(held.fit, options.half_deals)
    growth = growth_by_halves(ratio, options.expected_half_ratio, 5 * options.half_deals)
    # Both count what surfaces have in common: once is enough.
    if matches.sharing > 1.0:
        growth *= matches.sharing
    elif ratio is not None:
        growth *= growth_between_patches(held.fit) * growth_beyond_patches(ratio, options)
    covariance = growth * held.covariance
    covariance[:3, :3] += shared_covariance(matches, options.shared_error_px)
    return covariance


class Untold(NamedTuple):
    """Why a direction cannot be told.

    Attributes
    ----------
    because : str
        In words.
    doubt : ndarray, shape (3, 3)
        What the covariance of the rotation is larger by, rad^2, since that is a part of it.
    """

    because: str
    doubt: np.ndarray


def _untold(
    held: Held, sigma: float, turned: Callable[[], TurningFit], rate: float
) -> Untold | None:
    """Of a direction with such a worst ``sigma``, rad; None where it can be told."""
    fit, rival = held.fit, held.rival
    if rival is not None and not rival.is_nearby(fit):
        because = _beside(held) if fit.shows_direction else f"{_beside(held)} {MOSTLY_NOISE}"
        return Untold(because, rival.doubt_of_rotation(fit))
    if is_one_object(fit.matches.rays0, fit.labels):
        apart = np.array(rotation_vector(turned().R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))
        return Untold(ONE_OBJECT, doubt_between(apart, 0.5))
    is_vague = sigma > MAX_DIRECTION_SIGMA or fit.sign_probability < 1.0 - rate
    if fit.shows_direction and not is_vague:
        return None
    because = (
        "The flow beyond the rotation is too short or too parallel: "
        f"its direction is uncertain by {math.degrees(sigma):.0f} deg, "
        f"its sign right with {100 * fit.sign_probability:.0f} %."
        if is_vague
        else MOSTLY_NOISE
    )
    apart = np.array(rotation_vector(turned().R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))
    return Untold(because, doubt_between(apart, SHORT_OF_TURN**2))


def _beside(held: Held) -> str:
    """A sentence of the other motion, if there is one."""
    return "" if held.rival is None else held.rival.said_beside(held.fit)
