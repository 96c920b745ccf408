"""The motion between two views of a rolling shutter: what it undoes in each row leads to itself."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3
from farpoint.pose.matches import Matches, PixelMatches
from farpoint.pose.moving_fit import MovingFit, refit_moving
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter
from farpoint.pose.two_views import estimate, search

__all__ = ["Searched", "estimate_rolling", "search_rolling"]

_MOST_PASSES = 4
_CLOSE = 0.1  # sigma: no pass changes more


class Searched(NamedTuple):
    """Motions that a search found.

    Attributes
    ----------
    fit : MovingFit
        The likeliest.
    theta : ndarray, shape (3,)
        Rotation vector that was undone for it, rad.
    other : MovingFit, optional
        A predicted one in another direction: which is the likelier, unrolled rows decide.
    """

    fit: MovingFit
    theta: np.ndarray
    other: MovingFit | None = None


def search_rolling(
    shutter: Shutter | None, pixels: PixelMatches, options: RelativePoseOptions, seed: int
) -> Searched | None:
    """The motion that a search finds, with the rotation undone that was before; None of too few."""
    theta = np.zeros(3)
    if shutter is None or shutter.turning is None or shutter.turning.before is None:
        fit = search(pixels.matches(), options, seed)
    else:
        theta = shutter.turning.before
        fit = search(pixels.matches(partial(shutter.unrolled, theta)), options, seed)
    return None if fit is None else Searched(fit, theta)


def estimate_rolling(
    shutter: Shutter,
    pixels: PixelMatches,
    options: RelativePoseOptions,
    seed: int,
    searched: Searched | None,
) -> RelativePose:
    """The motion whose own rotation, undone in each row, leads to itself.

    A fixed point: what is wrong of the rotation that is undone returns in the estimate by its share
    of the time between the rows. That all matches have in common is taken out (Newton); what is
    left shrinks by its spread in every pass. Without a motion ``searched`` a first search finds the
    rotation to begin with, and each pass begins with another.
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
        pose = estimate(matches, options.matching_tolerance_px, options, seed, start)
        R, R_covariance, C = pose.rotation_cam1_from_cam0, pose.rotation_covariance, pose.covariance
        if R is None or R_covariance is None:
            return pose
        assert pose.noise_px is not None
        used = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
        before, (theta, time_between) = theta, _unrolled(shutter, R, used, theta)
        left = _left(shutter, matches, theta - before, pose.noise_px)
        if left <= _CLOSE or passes == _MOST_PASSES:
            # The rows of a match see the rotation of the time between them.
            by_time = np.diag([1.0 / time_between] * 3 + [1.0, 1.0])
            return replace(
                pose,
                rotation_cam1_from_cam0=so3.exp(theta),
                rotation_covariance=R_covariance / time_between**2,
                covariance=None if C is None else by_time @ C @ by_time,
            )


def _closer(
    shutter: Shutter, pixels: PixelMatches, searched: Searched
) -> tuple[MovingFit, np.ndarray]:
    """The motion refitted, and its rotation, until that which is left is within its noise."""
    closer = _closer_to(shutter, pixels, searched.fit, searched.theta)
    if searched.other is None:
        return closer
    other = _closer_to(shutter, pixels, searched.other, searched.theta)
    return max(closer, other, key=lambda each: each[0].log_likelihood)


def _closer_to(
    shutter: Shutter, pixels: PixelMatches, fit: MovingFit, theta: np.ndarray
) -> tuple[MovingFit, np.ndarray]:
    theta, _ = _unrolled(shutter, fit.R_cam1_from_cam0, fit.matches.used(fit.labels), theta)
    for _ in range(_MOST_PASSES):
        matches = pixels.matches(partial(shutter.unrolled, theta))
        fit = refit_moving(matches, fit)
        used = matches.used(fit.labels)
        before, (theta, _) = theta, _unrolled(shutter, fit.R_cam1_from_cam0, used, theta)
        if _left(shutter, matches, theta - before, fit.noise.sigma) <= 1.0:
            break
    return fit, theta


def _left(shutter: Shutter, matches: Matches, change: np.ndarray, noise: float) -> float:
    """What a change of the rotation, (3,) rad, leaves for the next pass, in sigma of a rotation."""
    spread = abs(shutter.share) * float(np.std(shutter.phase1 - shutter.phase0))
    # Of one that all matches tell: what is stated is larger where two motions are met.
    sigma = noise / float(np.sqrt(np.sum(matches.precision)))
    return spread * float(np.linalg.norm(change)) / sigma


def _unrolled(
    shutter: Shutter, R_cam1_from_cam0: np.ndarray, used: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rotation vector of a motion that was estimated with ``theta`` undone, and rows' mean time.

    By the matches ``used``, indices.
    """
    time_between = shutter.time_between(used)
    found = so3.log(R_cam1_from_cam0)
    return (found + (time_between - 1.0) * theta) / time_between, time_between
