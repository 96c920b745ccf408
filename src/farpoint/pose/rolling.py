"""The motion between two rolling-shutter views, as a fixed point of the shutter correction."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import ALTERNATIONS
from farpoint.geometry import so3
from farpoint.pose.constants import ROWS_CONVERGED_SIGMA
from farpoint.pose.general_motion import GeneralMotionFit, refit_general_motion
from farpoint.pose.matches import PixelMatches
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter
from farpoint.pose.track_errors import TrackErrors
from farpoint.pose.two_views import estimate, search

__all__ = ["Searched", "estimate_rolling", "search_rolling"]


class Searched(NamedTuple):
    """Motions that a search found.

    Attributes
    ----------
    fit : GeneralMotionFit
        The likeliest motion.
    theta : ndarray, shape (3,)
        Rotation vector, rad, that was undone in the rows before the search.
    other : GeneralMotionFit, optional
        The predicted motion, if its direction differs. Both motions are compared after correction
        of the rows.
    """

    fit: GeneralMotionFit
    theta: np.ndarray
    other: GeneralMotionFit | None = None


def search_rolling(
    shutter: Shutter | None, pixels: PixelMatches, options: RelativePoseOptions, seed: int
) -> Searched | None:
    """Search for the motion after the predicted rotation of each row is undone.

    The result is None for too few matches.
    """
    theta = np.zeros(3)
    if shutter is None or shutter.angular_prior is None or shutter.angular_prior.before is None:
        fit = search(pixels.matches(), options, seed)
    else:
        theta = shutter.angular_prior.before
        fit = search(pixels.matches(partial(shutter.unrolled, theta)), options, seed)
    return None if fit is None else Searched(fit, theta)


def estimate_rolling(
    shutter: Shutter,
    pixels: PixelMatches,
    options: RelativePoseOptions,
    seed: int,
    searched: Searched | None,
    errors: TrackErrors,
) -> RelativePose:
    """Estimate the motion so that the rotation undone in the rows equals the estimated rotation.

    The estimate is a fixed point. An error of the undone rotation displaces each match in
    proportion to the difference of its two read-out phases. A Newton step removes the effect of the
    mean difference. In every pass, the remaining error becomes smaller by a factor equal to the
    scatter of the differences times the relative read-out time. If no motion ``searched`` is given,
    a first search finds the initial rotation, and each pass begins with another search.
    """
    theta, start = np.zeros(3), None
    if searched is not None:
        start, theta = _closer(shutter, pixels, searched)
    elif options.refine and (first := search_rolling(shutter, pixels, options, seed)) is not None:
        _, theta = _closer(shutter, pixels, first)
    passes = 0
    while True:
        passes += 1
        matches = pixels.matches(partial(shutter.unrolled, theta))
        pose = estimate(matches, options.matching_tolerance_px, options, seed, start, errors)
        R, R_covariance, C = pose.rotation_cam1_from_cam0, pose.rotation_covariance, pose.covariance
        if R is None or R_covariance is None:
            return pose
        used = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
        before, (theta, time_between) = theta, _unrolled(shutter, R, used, theta)
        error = _remaining(shutter, theta - before)
        sigmas = math.sqrt(error @ np.linalg.solve(R_covariance, error))
        if sigmas <= ROWS_CONVERGED_SIGMA or passes == ALTERNATIONS:
            # The time between a match's rows is not that between the middle rows.
            by_time = np.diag([1.0 / time_between] * 3 + [1.0, 1.0])
            return replace(
                pose,
                rotation_cam1_from_cam0=so3.exp(theta),
                rotation_covariance=R_covariance / time_between**2,
                covariance=None if C is None else by_time @ C @ by_time,
            )


def _closer(
    shutter: Shutter, pixels: PixelMatches, searched: Searched
) -> tuple[GeneralMotionFit, np.ndarray]:
    """The likelier motion of ``searched`` after correction of the rows, and its rotation vector."""
    closer = _closer_to(shutter, pixels, searched.fit, searched.theta)
    if searched.other is None:
        return closer
    other = _closer_to(shutter, pixels, searched.other, searched.theta)
    return max(closer, other, key=lambda each: each[0].log_evidence)


def _closer_to(
    shutter: Shutter, pixels: PixelMatches, fit: GeneralMotionFit, theta: np.ndarray
) -> tuple[GeneralMotionFit, np.ndarray]:
    """A motion and its rotation vector, refitted until the error of the undone rotation is small.

    The error is small if it is within the noise of the rotation.
    """
    theta, _ = _unrolled(shutter, fit.R_cam1_from_cam0, fit.matches.used(fit.labels), theta)
    for _ in range(ALTERNATIONS):
        matches = pixels.matches(partial(shutter.unrolled, theta))
        fit = refit_general_motion(matches, fit)
        used = matches.used(fit.labels)
        before, (theta, _) = theta, _unrolled(shutter, fit.R_cam1_from_cam0, used, theta)
        # The 1-sigma of a rotation by all matches is less than that of a motion.
        sigma = fit.noise.sigma / math.sqrt(np.sum(matches.precision))
        if np.linalg.norm(_remaining(shutter, theta - before)) <= sigma:
            break
    return fit, theta


def _remaining(shutter: Shutter, change: np.ndarray) -> np.ndarray:
    """Error (3,) of the rotation, rad, that remains after a ``change`` (3,) of the rotation."""
    spread = abs(shutter.share) * float(np.std(shutter.phase1 - shutter.phase0))
    return spread * change


def _unrolled(
    shutter: Shutter, R_cam1_from_cam0: np.ndarray, used: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rotation vector of a motion, and the mean time between the rows of the matches ``used``.

    The motion was estimated with the rotation vector ``theta`` undone in the rows. ``used`` holds
    indices of matches.
    """
    time_between = shutter.time_between(used)
    found = so3.log(R_cam1_from_cam0)
    return (found + (time_between - 1.0) * theta) / time_between, time_between
