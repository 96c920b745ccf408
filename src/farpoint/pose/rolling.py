"""The motion between two rolling-shutter views, as a fixed point of the shutter correction."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import ALTERNATIONS
from farpoint.geometry import so3
from farpoint.pose.conclusion import with_covariance
from farpoint.pose.constants import ROWS_CONVERGED_SIGMA
from farpoint.pose.general_motion import GeneralMotionFit, refit_general_motion
from farpoint.pose.matches import PixelMatches
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter
from farpoint.pose.track_errors import TrackErrors
from farpoint.pose.two_views import estimate, search
from farpoint.pose.velocity_changes import VelocityChanges

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
    if shutter is None or shutter.prior is None or shutter.prior.before is None:
        fit = search(pixels.matches(), options, seed)
    else:
        theta = shutter.prior.before
        fit = search(pixels.matches(partial(shutter.unrolled, theta)), options, seed)
    return None if fit is None else Searched(fit, theta)


def estimate_rolling(
    shutter: Shutter,
    pixels: PixelMatches,
    options: RelativePoseOptions,
    seed: int,
    searched: Searched | None,
    errors: TrackErrors,
) -> tuple[RelativePose, Shutter]:
    """Estimate the motion so that the rotation undone in the rows equals the estimated rotation.

    The estimate is a fixed point. An error of the undone rotation displaces each match in
    proportion to the difference of its two read-out phases. A Newton step removes the effect of the
    mean difference. In every pass, the remaining error becomes smaller by a factor equal to the
    scatter of the differences times the relative read-out time. If no motion ``searched`` is given,
    a first search finds the initial rotation, and each pass begins with another search. The shutter
    is also returned, with the estimated changes of the velocity.
    """
    theta, start, corrected = np.zeros(3), None, None
    tempering = errors.expected_inflation(options.common_error_slope)
    if searched is not None:
        corrected = _closer(shutter, pixels, searched, tempering)
        start = corrected.fit
    elif options.refine and (first := search_rolling(shutter, pixels, options, seed)) is not None:
        corrected = _closer(shutter, pixels, first, tempering)
    if corrected is not None:
        theta, shutter = corrected.theta, corrected.shutter
    passes = 0
    while True:
        passes += 1
        matches = pixels.matches(partial(shutter.unrolled, theta))
        pose = estimate(matches, options.matching_tolerance_px, options, seed, start, errors)
        R, R_covariance = pose.rotation_cam1_from_cam0, pose.rotation_covariance
        if R is None or R_covariance is None:
            return pose, shutter
        used = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
        before, (theta, time_between) = theta, _unrolled(shutter, R, used, theta)
        error = _remaining(shutter, theta - before)
        sigmas = math.sqrt(error @ np.linalg.solve(R_covariance, error))
        if sigmas <= ROWS_CONVERGED_SIGMA or passes == ALTERNATIONS:
            break
    changes = None if corrected is None else corrected.changes
    return _of_middle_rows(pose, theta, time_between, changes), shutter


def _of_middle_rows(
    pose: RelativePose, theta: np.ndarray, time_between: float, changes: VelocityChanges | None
) -> RelativePose:
    """The motion ``theta`` between the middle rows, with the uncertainty of the changes.

    The time between the rows of a match is ``time_between`` times that between the middle rows.
    """
    by_changes = np.zeros((5, 5)) if changes is None else changes.covariance(pose.direction_basis)
    by_time = np.diag([1.0 / time_between] * 3 + [1.0, 1.0])
    pose = replace(pose, rotation_cam1_from_cam0=so3.exp(theta))
    if pose.covariance is not None:
        return with_covariance(pose, by_time @ (pose.covariance + by_changes) @ by_time)
    assert pose.rotation_covariance is not None
    rotation = pose.rotation_covariance + by_changes[:3, :3]
    return replace(pose, rotation_covariance=rotation / time_between**2)


class _Corrected(NamedTuple):
    """A motion after correction of the rows.

    Attributes
    ----------
    fit : GeneralMotionFit
        The motion.
    theta : ndarray, shape (3,)
        Its rotation vector, rad.
    shutter : Shutter
        The shutter with which the rows were corrected.
    changes : VelocityChanges, optional
        Equations of the changes of the velocity; None if the velocity is constant.
    """

    fit: GeneralMotionFit
    theta: np.ndarray
    shutter: Shutter
    changes: VelocityChanges | None = None


def _closer(
    shutter: Shutter, pixels: PixelMatches, searched: Searched, tempering: float
) -> _Corrected:
    """The likelier motion of ``searched`` after correction of the rows."""
    closer = _closer_to(shutter, pixels, searched.fit, searched.theta, tempering)
    if searched.other is None:
        return closer
    other = _closer_to(shutter, pixels, searched.other, searched.theta, tempering)
    return max(closer, other, key=lambda each: each.fit.log_evidence)


def _closer_to(
    shutter: Shutter,
    pixels: PixelMatches,
    fit: GeneralMotionFit,
    theta: np.ndarray,
    tempering: float,
) -> _Corrected:
    """The likeliest of the motions that refits find, each after another correction of the rows.

    The refits end if the error of the correction is within its noise.
    """
    theta, _ = _unrolled(shutter, fit.R_cam1_from_cam0, fit.matches.used(fit.labels), theta)
    passes: list[_Corrected] = []
    for _ in range(ALTERNATIONS):
        matches = pixels.matches(partial(shutter.unrolled, theta))
        fit = refit_general_motion(matches, fit)
        before, (theta, _) = (
            theta,
            _unrolled(shutter, fit.R_cam1_from_cam0, matches.used(fit.labels), theta),
        )
        # The 1-sigma of a rotation by all matches is less than that of a motion.
        sigma = fit.noise.sigma / math.sqrt(np.sum(matches.precision))
        is_final = np.linalg.norm(_remaining(shutter, theta - before)) <= sigma
        updated, changes = shutter, None
        if shutter.prior is not None:
            changes = VelocityChanges.of(shutter, shutter.prior, fit)
            updated, sigmas = changes.step(tempering)
            is_final = is_final and sigmas <= ROWS_CONVERGED_SIGMA
        passes.append(_Corrected(fit, theta, shutter, changes))
        if is_final:
            break
        shutter = updated
    return max(passes, key=lambda each: each.fit.log_evidence)


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
