"""Explanations of the matches by two motions: that of the camera, and another beside it.

A mean motion between the two explains all matches with more noise, and may be the likelier one:
the noise scale is free. Two facts tell it from the camera's: matches that stand still in the image
while the others move (dirt on the lens, the bonnet, a caption), and residuals that are correlated
between neighbours and that a split into two motions explains.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter

import numpy as np

from farpoint._kernels.evidence import find_standing
from farpoint._kernels.plausible import BAND_SIGMA
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import (
    MovingFit,
    fit_moving,
    fit_quietly,
    is_plainly_likelier,
    judge,
    refit_moving,
)
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.patches import patches_of

__all__ = ["CORRELATED", "dominant_motion", "is_correlated", "without_stationary"]

# Distance, in sigma of the noise, within which a match stands still in the image.
STILL_SIGMA = 3.0
# Stationary matches: fewer, or a smaller share, are outliers as others are; of a larger share that
# stands still the camera itself stands still.
FEWEST, LEAST_SHARE, MOST_SHARE = 8, 0.05, 0.5
# Correlation of neighbouring residuals from which on a motion may be a mean of two; and where more
# than this share of the matches is repeated, so that many of the other motion are rejected.
CORRELATED, BESIDE_REPEATED, MANY_REPEATED = 0.6, 0.4, 0.1
# Noise over the tolerance: with less, trackers alone make neighbouring residuals alike.
LEAST_NOISE = 0.1
# Standard deviation of a normal distribution over its median absolute deviation.
MAD_TO_SIGMA = 1.4826
# Least share of the variance that is independent: two matches of one point share all of it.
LEAST_OWN = 0.05
# Bounds of the noise variance over the independent one: in the search, and in the refinements.
NARROW, BOUNDS = 0.2, (1.0, 0.5, 0.25, 0.125)
# Samples of the search: enough where half of the matches are of the dominant motion.
SAMPLES = 300
# Least share of the matches that the dominant motion has.
DOMINANT_SHARE = 1.0 / 3.0
# A second motion leaves a gap in the distribution of residuals: fewer lie within one to two bounds
# than these shares of those beyond, and of those within.
OF_MOVED, OF_AGREEING = 1.0 / 3.0, 0.2
# Share of the residuals' correlation that a split leaves, at the most: errors that are smooth over
# the image, of a shutter or a lens, are so on either side of any split.
EXPLAINED = 0.5
# Correlation from which on a part of the image may have a motion of its own; discs around so many
# matches, of these shares of all, are tried, of at least so many matches.
SUSPECT, CENTERS, SHARES, LEAST_SPLIT = 0.3, 16, (0.1, 0.2, 0.3, 0.4, 0.5), 40
SCREENED = 100  # matches by which discs are compared, about
# Share of the squares that two motions leave of one's, at the most.
MOST_LEFT = 0.5
# Exchanges of patches between two parts, at most; matches that a part has, at least.
EXCHANGES, MIN_PART = 10, 20
NEAR_EPIPOLE = 1e-3  # rad


def without_stationary(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> tuple[Matches, MovingFit]:
    """The matches and their fit, without those that stand still in the image, if some do.

    Stationary matches are left out if they contradict the motion of the others, and more of these
    agree on it than stand still. Far points stand still where the camera does not turn, and
    contradict nothing.
    """
    stationary = np.empty(len(matches), bool)
    within = min(STILL_SIGMA * fit.noise.sigma, tolerance)
    count = find_standing(matches.pairs, within, stationary)
    least, most = LEAST_SHARE * len(matches), MOST_SHARE * len(matches)
    if count < FEWEST or not least <= count <= most:
        return matches, fit
    others = matches.select(~stationary)
    found = fit_moving(others, tolerance, options, state)
    _, _, probability = judge(matches.select(stationary), found)
    if found.agreeing <= count or np.count_nonzero(probability > 0.5) > count / 2:
        return matches, fit
    return others, found


def is_correlated(fit: MovingFit, tolerance: float) -> bool:
    """Whether residuals of neighbours are so alike that the motion may be a mean of two."""
    many_repeated = fit.noise.wrong * fit.noise.repeated > MANY_REPEATED
    limit = BESIDE_REPEATED if many_repeated else CORRELATED
    return fit.coherence >= limit and fit.noise.sigma >= LEAST_NOISE * tolerance


def dominant_motion(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """The fit, or the motion of most of its matches, if the fit is a mean of that and another.

    The independent part of the noise is what neighbouring residuals do not share. With no more
    noise than that either motion is likelier than the mean of both. A split counts if it leaves a
    gap between the two, and residuals that are independent; else the fit stays, unless the search
    with less noise found a motion that is plainly likelier.
    """
    if fit.coherence < SUSPECT or fit.noise.sigma < LEAST_NOISE * tolerance:
        return fit
    splits = [_split(matches, fit, part) for part in _of_two_parts(matches, fit)]
    found = max(filter(None, splits), key=attrgetter("agreeing"), default=None)
    if found is not None or not is_correlated(fit, tolerance):
        return found or fit
    narrow = fit_quietly(matches, NARROW * _own(fit), SAMPLES, tolerance, options, state)
    split = _split(matches, fit, narrow)
    if split is not None:
        return split
    found = refit_moving(matches, narrow)
    return found if is_plainly_likelier(found, fit) else fit


def _own(fit: MovingFit) -> float:
    """Variance of the residuals that neighbours do not share.

    Of inliers of either kind: many of a second motion are taken for the heavy tail.
    """
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(fit.residual[fit.probability > 0.5])))
    return max(1.0 - fit.coherence, LEAST_OWN) * sigma**2


def _split(matches: Matches, fit: MovingFit, start: MovingFit) -> MovingFit | None:
    """The motion near a start, if it is that of most matches, and others have one of their own."""
    own = _own(fit)
    residual = np.abs(judge(matches, start)[0, fit.probability > 0.5])
    for bound in BOUNDS:
        if _has_gap(residual, BAND_SIGMA * math.sqrt(bound * own)):
            found = refit_moving(matches.with_noise_up_to(bound * own), start)
            is_dominant = found.agreeing > DOMINANT_SHARE * fit.agreeing
            if is_dominant and found.coherence < EXPLAINED * min(fit.coherence, CORRELATED):
                return replace(found, between=fit.coherence)
            return None
    return None


def _has_gap(residual: np.ndarray, bound: float) -> bool:
    """Whether residuals beyond a bound are no tail of those within."""
    agreeing, near = np.count_nonzero(residual < bound), np.count_nonzero(residual < 2.0 * bound)
    tail, moved = near - agreeing, residual.size - agreeing
    return bool(tail < min(OF_MOVED * moved, OF_AGREEING * agreeing))


def _of_two_parts(matches: Matches, fit: MovingFit) -> Iterator[MovingFit]:
    """The motions of two parts of the image that are best explained by one each.

    Parts are made of patches. A motion of its own leaves a part, to first order, the residuals
    ``r + J x`` with ``x = -H^-1 g``, the gradient g and the information H at the fit. From the best
    of some discs and the rest on, each patch goes to the part that it fits better.
    """
    if len(matches) < LEAST_SPLIT:
        return
    r, J = _linearised(matches, fit)
    rows = np.concatenate([r[:, None], J], axis=1) * np.sqrt(fit.probability)[:, None]
    squares = rows[:, :, None] * rows[:, None, :]  # (N, 6, 6)
    total, patch = np.sum(squares, axis=0), patches_of(matches.rays0)
    moved = _best_disc(matches.rays0, squares, total)
    for _ in range(EXCHANGES):
        within = np.sum(squares[moved], axis=0)
        steps = [_own_step(part) for part in (total - within, within)]
        apart = [(r + J @ step) ** 2 for step in steps]
        gain = np.bincount(patch, fit.probability * (apart[0] - apart[1]))
        before, moved = moved, gain[patch] > 0.0
        if (moved == before).all():
            break
    within = np.sum(squares[moved], axis=0)
    left = sum(_left_over(part[None])[0] for part in (total - within, within))
    if left > MOST_LEFT * total[0, 0]:
        return
    for part in (moved, ~moved):
        if np.count_nonzero(part) >= MIN_PART:
            yield refit_moving(matches.select(part), fit)


def _best_disc(rays: np.ndarray, squares: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Mask (N,) of a disc, around one of the rays, that leaves the least with two motions."""
    some = np.arange(0, len(rays), max(len(rays) // SCREENED, 1))
    n, scale = len(some), len(rays) / len(some)
    cosines = rays[some[np.arange(CENTERS) * n // CENTERS]] @ rays[some].T
    nearest = np.argsort(-cosines, axis=1)
    counts = np.array([round(share * n) for share in SHARES])
    within = scale * np.cumsum(squares[some][nearest], axis=1)[:, counts - 1].reshape(-1, 6, 6)
    left = _left_over(within) + _left_over(total - within)
    disc, count = divmod(int(np.argmin(left)), len(counts))
    center, last = nearest[disc, 0], nearest[disc, counts[count] - 1]
    return rays @ rays[some[center]] >= cosines[disc, last]


def _own_step(squares: np.ndarray) -> np.ndarray:
    """Gauss-Newton step (5,) of the ``[r, J]`` products (6, 6) of a part."""
    H = squares[1:, 1:]
    return -np.linalg.solve(H + (1e-9 * np.trace(H) + 1e-300) * np.eye(5), squares[1:, 0])


def _left_over(squares: np.ndarray) -> np.ndarray:
    """Squares (K,) left by a motion of its own, of ``[r, J]`` products (K, 6, 6)."""
    g, H = squares[:, 1:, 0], squares[:, 1:, 1:]
    scale = np.trace(H, axis1=1, axis2=2)[:, None, None] * 1e-9 + 1e-300
    step = np.linalg.solve(H + scale * np.eye(5), g[:, :, None])[:, :, 0]
    return squares[:, 0, 0] - np.sum(g * step, axis=1)


def _linearised(matches: Matches, fit: MovingFit) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (N,) in units of the noise, and their derivatives (N, 5) by ``[dtheta, dbeta]``."""
    t, a, b = fit.direction_cam1_from_cam0, matches.rays0 @ fit.R_cam1_from_cam0.T, matches.rays1
    normal = np.cross(t, a)
    scale = np.sqrt(matches.precision) / np.maximum(np.linalg.norm(normal, axis=1), NEAR_EPIPOLE)
    by_pose = np.hstack([np.cross(a, np.cross(b, t)), np.cross(a, b) @ tangent_basis(t)])
    return scale * np.sum(normal * b, axis=1), scale[:, None] * by_pose
