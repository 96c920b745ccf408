"""The method on one screen: rotation from far rays, direction of travel from the flow that remains,
both refined together, and a verdict on what the matches can tell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint._kernels.motion import fit_motion
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.pose import conclusion
from farpoint.pose.certainty import MAX_DIRECTION_SIGMA, direction_sigma, fixes_rotation
from farpoint.pose.closed_form import estimate_closed_form
from farpoint.pose.conclusion import Course, given_labels, label_matches
from farpoint.pose.covariance import (
    growth_between_patches,
    growth_by_halves,
    half_ratio,
    half_ratio_of_turn,
    moving_covariance,
    shared_covariance,
)
from farpoint.pose.far_rotation import IDENTITY, far_rotation
from farpoint.pose.majority import BETWEEN, majority_motion
from farpoint.pose.matches import Matches, matches_from_points, matches_from_rays
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import doubt_where_alike
from farpoint.pose.noise_floor import noise_floor
from farpoint.pose.options import DEFAULTS, RelativePoseOptions
from farpoint.pose.result import PoseStatus, RelativePose
from farpoint.pose.rivals import doubt_between, hold_against_rivals, likelier_of_plane
from farpoint.pose.small import rotation_vector
from farpoint.pose.stuck import without_stuck
from farpoint.pose.turning_fit import TurningFit, turning_when_asked
from farpoint.pose.verdict import (
    is_consensus,
    is_motion,
    is_plainly_translating,
    is_static,
    shown_translation,
)

__all__ = ["estimate_relative_pose", "estimate_relative_pose_from_rays"]

# Five matches fix a motion; a consensus needs a few more that could have disagreed.
MIN_MATCHES = 8
# A motion that leaves so much less noise than a rotation may be the truth, be there ever so few
# matches to say so.
FAR_LESS_NOISE = 0.5
# Share of a flow too short for a direction that noise makes, about: so far towards that of a turn
# may the rotation be.
SHORT_OF_TURN = 0.5
MOSTLY_NOISE = "The flow beyond the rotation is too short: most of it is noise."


def estimate_relative_pose(
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera | None = None,
    *,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
    covariance0_px2: np.ndarray | None = None,
    covariance1_px2: np.ndarray | None = None,
) -> RelativePose:
    """Motion between two views of calibrated cameras, with its covariance.

    Parameters
    ----------
    points0, points1 : ndarray, shape (N, 2)
        Matching pixels in image 0 and image 1; the centre of the top-left pixel is (0, 0).
    camera0 : Camera
        Camera of image 0, and of image 1 unless ``camera1`` is given.
    camera1 : Camera, optional
        Camera of image 1.
    options : RelativePoseOptions, optional
        Defaults serve tracks and still matches alike.
    seed : int
        Of the random samples; the same inputs, options and seed give the same result, bit for bit.
    covariance0_px2, covariance1_px2 : ndarray, shape (N, 2, 2), optional
        Noise of each point, px^2, up to a common factor, which is estimated. An image without is
        taken to have isotropic noise of the median variance of the other.

    Returns
    -------
    RelativePose
        With a status: too few or contradicting matches are no error.

    Raises
    ------
    ValueError
        Wrong shapes, unequal counts, NaN or infinite values; names the argument.

    Notes
    -----
    Burschka and Mair, "Direct Pose Estimation with a Monocular Camera", Robot Vision 2008,
    LNCS 4931, then refined to the maximum likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> from farpoint import Camera, estimate_relative_pose
    >>> camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    >>> estimate_relative_pose(np.empty((0, 2)), np.empty((0, 2)), camera).status
    <PoseStatus.FAILED: 'FAILED'>
    """
    options = options or DEFAULTS
    matches = matches_from_points(
        points0, points1, camera0, camera1 or camera0, covariance0_px2, covariance1_px2
    )
    return _estimate(matches, options.matching_tolerance_px, options, seed)


def estimate_relative_pose_from_rays(
    rays0: np.ndarray,
    rays1: np.ndarray,
    *,
    noise_rad: float,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
) -> RelativePose:
    """Motion between two views of any central camera, from rays (N, 3) in camera 0 and camera 1.

    As `estimate_relative_pose` with the 1-sigma noise of a ray in each direction, ``noise_rad``
    (rad), as the unit: ``noise_px`` of the result is a multiple of it.
    """
    options = options or DEFAULTS
    matches = matches_from_rays(rays0, rays1, noise_rad)
    return _estimate(matches, max(options.matching_tolerance_px, 3.0), options, seed)


def _estimate(
    matches: Matches, tolerance: float, options: RelativePoseOptions, seed: int
) -> RelativePose:
    course = Course()
    if len(matches) < MIN_MATCHES:
        return conclusion.failed_pose(
            f"Too few matches: {len(matches)} usable of {matches.total} given, "
            f"at least {MIN_MATCHES} are needed.",
            matches.total,
            course,
        )
    with AnnouncedCompilation(fit_motion):
        return _find(matches, tolerance, options, _random_state(seed), course)


def _find(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
    course: Course,
) -> RelativePose:
    if not options.refine:
        rotation = far_rotation(matches, tolerance, state)
        return estimate_closed_form(matches, rotation, tolerance, options, state, course)
    moving = fit_moving(matches, tolerance, options, state)
    course.iterations = moving.iterations
    course.lap("search_s")
    floor = noise_floor(matches, moving)
    if floor and matches.told is not None:
        matches = matches.told.with_floor(floor)
        # What the search made of a plane, it did with noise that was told wrong.
        moving = replace(refit_moving(matches, moving), is_planar=True)
        course.lap("refinement_s")
    given = len(matches)
    matches, moving = without_stuck(matches, moving, tolerance, options, state)
    if len(matches) < given:
        course.remark(
            f"{given - len(matches)} matches stand still in the image: they go along with the "
            "camera, as dirt on its lens does."
        )
    moving = majority_motion(matches, moving, tolerance, options, state)
    if max(moving.coherence, moving.between) > BETWEEN:
        course.remark(
            "Neighbouring matches are off alike: by the lens or the shutter, or some move by "
            "themselves or were taken for the next of their kind."
        )
    if options.count_sharing:
        matches, moving = doubt_where_alike(matches, moving)
        course.sharing = matches.sharing
    turned = turning_when_asked(matches, moving.far_rotation_cam1_from_cam0, tolerance)
    if is_plainly_translating(moving):
        return _conclude_moving(matches, moving, turned, options, course)
    shown = shown_translation(matches, moving, turned(), options.false_alarm_rate)
    if shown >= 1.0:
        return _conclude_moving(matches, moving, turned, options, course)
    return _conclude_turning(matches, turned(), moving, shown, options, course)


def _conclude_moving(
    matches: Matches,
    fit: MovingFit,
    turned: Callable[[], TurningFit],
    options: RelativePoseOptions,
    course: Course,
) -> RelativePose:
    """As a motion; the matches are fitted as a turn where that is asked for."""
    fit, other = likelier_of_plane(fit)
    course.lap("refinement_s")
    rate = options.false_alarm_rate
    if not is_motion(fit, rate):
        return conclusion.no_consensus(matches, fit.agreeing, course)
    fit, covariance, rival = hold_against_rivals(fit, other, turned, rate)
    ratio = course.half_ratio = half_ratio(fit, options.half_deals)
    covariance *= growth_by_halves(ratio, options.expected_half_ratio, 5 * options.half_deals)
    # Both count what surfaces have in common: once is enough.
    if matches.sharing > 1.0:
        covariance *= matches.sharing
    elif ratio is not None:
        covariance *= growth_between_patches(fit)
    covariance[:3, :3] += shared_covariance(matches, options.shared_error_px)
    course.lap("covariance_s")
    if not fixes_rotation(covariance[:3, :3]):
        return conclusion.unfixed_rotation(matches, course)
    labels = given_labels(matches, fit.labels)
    sigma = direction_sigma(covariance)
    sign = 1.0 / (1.0 + math.exp(-min(max(fit.sign_log_odds, -700.0), 700.0)))
    course.cost, course.sign_probability = fit.cost, sign
    rotation_covariance = covariance[:3, :3]
    between = "" if rival is None else rival.said_beside(fit)
    if rival is not None and not rival.is_nearby(fit):
        doubtful = rotation_covariance + rival.doubt_of_rotation(fit)
        reason = between if fit.shows_direction else f"{between} {MOSTLY_NOISE}"
        return _rotation_alone(fit, reason, doubtful, labels, course)
    is_vague = sigma > MAX_DIRECTION_SIGMA or sign < 1.0 - rate
    if is_vague or not fit.shows_direction:
        reason = (
            "The flow beyond the rotation is too short or too parallel: "
            f"its direction is uncertain by {math.degrees(sigma):.0f} deg, "
            f"its sign right with {100 * sign:.0f} %."
            if is_vague
            else MOSTLY_NOISE
        )
        apart = np.array(rotation_vector(turned().R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))
        doubtful = rotation_covariance + doubt_between(apart, SHORT_OF_TURN**2)
        return _rotation_alone(fit, reason, doubtful, labels, course)
    return conclusion.observed(
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        covariance,
        sigma,
        labels,
        fit.noise.mean_sigma,
        course,
        between,
    )


def _rotation_alone(
    fit: MovingFit,
    reason: str,
    covariance: np.ndarray,
    labels: np.ndarray,
    course: Course,
) -> RelativePose:
    """The rotation of a motion whose direction cannot be told."""
    return conclusion.turned(
        PoseStatus.ROTATION_ONLY,
        reason,
        fit.R_cam1_from_cam0,
        covariance,
        labels,
        fit.noise.mean_sigma,
        course,
    )


def _doubt_if_moving(fit: TurningFit, moving: MovingFit) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation that may as well be that of a motion.

    About which axis the two differ depends on a direction that is not known.
    """
    apart = rotation_vector(fit.R_cam1_from_cam0 @ moving.R_cam1_from_cam0.T)
    doubt = 0.5 * math.hypot(*apart) ** 2 * IDENTITY
    own = moving.matches.sharing * moving_covariance(moving)[:3, :3]
    return doubt + own if fixes_rotation(own) else doubt


def _conclude_turning(
    matches: Matches,
    fit: TurningFit,
    moving: MovingFit,
    shown: float,
    options: RelativePoseOptions,
    course: Course,
) -> RelativePose:
    """As a rotation. Its covariance holds that of the motion as far as one is ``shown``."""
    sigma = fit.noise.sigma
    right = fit.probability > 0.5
    agreeing = int(np.count_nonzero(right))
    chance = math.pi / 4.0 * (3.0 * sigma / matches.spread) ** 2
    if not is_consensus(agreeing, len(matches), 2, chance, options.false_alarm_rate):
        return conclusion.no_consensus(matches, agreeing, course)
    course.cost = fit.cost
    ratio = course.half_ratio = half_ratio_of_turn(matches, fit, options.half_deals)
    growth = growth_by_halves(ratio, options.expected_half_ratio, 3 * options.half_deals)
    covariance = matches.sharing * growth * fit.covariance
    covariance += shared_covariance(matches, options.shared_error_px)
    stands_still = is_static(fit.R_cam1_from_cam0, covariance, options.false_alarm_rate)
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


def _random_state(seed: int) -> np.ndarray:
    if not isinstance(seed, (int, np.integer)):
        raise InputError(f"expected a whole number, got {seed!r}", field="seed")
    return np.array([int(seed) % 2**64], np.uint64)
