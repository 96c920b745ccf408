"""Image pairs with a second motion, of a moving object or of matches fixed in the image.

A merged mode between the two motions explains all matches with more noise. The merged mode may be
likelier than the motion of the camera, because the noise scale is free. There are two signs of a
merged mode. First, some matches stand still in the image while the other matches move (dirt on the
lens, the bonnet, a caption). Second, residuals of neighbours are correlated, and the correlation
vanishes if the matches are split into two motions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter

import numpy as np

from farpoint._kernels.constants import COARSE_STEPS, GATE_SIGMA, MIN_MATCHES, MIN_SHARE
from farpoint._kernels.evidence import find_stationary
from farpoint.geometry.sphere import tangent_basis
from farpoint.geometry.vectors import cross, median
from farpoint.pose.constants import (
    DISC_CENTERS,
    DISC_MATCHES,
    DISC_SHARES,
    DOMINANT_SHARE,
    GAP_OF_AGREEING,
    GAP_OF_MOVED,
    MAD_TO_SIGMA,
    MAX_LEFT_BY_SPLIT,
    MAX_STATIONARY_SHARE,
    MERGED_MODE_CORRELATION,
    MERGED_MODE_CORRELATION_REPEATED,
    MERGED_MODE_NOISE_RATIO,
    MIN_INDEPENDENT_SHARE,
    MIN_PART_MATCHES,
    MIN_STATIONARY_SHARE,
    NEAR_EPIPOLE_RAD,
    REFINED_NOISE_BOUNDS,
    SEARCH_NOISE_BOUND,
    SEARCH_SAMPLES,
    SUSPECT_CORRELATION,
)
from farpoint.pose.general_motion import (
    GeneralMotionFit,
    evaluate_matches,
    fit_general_motion,
    fit_with_bounded_noise,
    is_clearly_likelier,
    refit_general_motion,
)
from farpoint.pose.matches import Matches
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.patches import patches_of

__all__ = ["dominant_motion", "is_correlated", "without_stationary"]


def without_stationary(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> tuple[Matches, GeneralMotionFit]:
    """The matches without stationary matches that contradict the other matches, and a new fit.

    Stationary matches are matches that do not move in the image. They are left out under two
    conditions: they contradict the motion of the other matches, and they are fewer than the matches
    that agree on that motion. If the camera does not rotate, far points are stationary, too, but
    far points contradict no motion.
    """
    stationary = np.empty(len(matches), bool)
    within = min(GATE_SIGMA * fit.noise.sigma, tolerance)
    count = find_stationary(matches.pairs, within, stationary)
    least, most = MIN_STATIONARY_SHARE * len(matches), MAX_STATIONARY_SHARE * len(matches)
    if count < MIN_MATCHES or not least <= count <= most:
        return matches, fit
    others = matches.select(~stationary)
    found = fit_general_motion(others, tolerance, options, state)
    _, _, probability = evaluate_matches(matches.select(stationary), found)
    if found.agreeing <= count or np.count_nonzero(probability > 0.5) > count / 2:
        return matches, fit
    return others, found


def is_correlated(fit: GeneralMotionFit, tolerance: float) -> bool:
    """Whether residuals are so correlated between neighbours that the fit may be a merged mode."""
    many_repeated = fit.noise.outlier_share * fit.noise.repeated_share > MIN_SHARE
    limit = MERGED_MODE_CORRELATION_REPEATED if many_repeated else MERGED_MODE_CORRELATION
    return (
        fit.neighbours.correlation >= limit
        and fit.noise.sigma >= MERGED_MODE_NOISE_RATIO * tolerance
    )


def dominant_motion(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> GeneralMotionFit:
    """The fit, or the dominant of two motions if the fit is a merged mode of these two motions.

    If the noise is limited to the part of the residuals that is independent between neighbours,
    each of the two motions is likelier than the merged mode. A split into two motions is accepted
    if the residuals have a gap between the two motions, and if the residuals within each motion are
    independent. Without an accepted split the fit is returned, unless a search with bounded noise
    finds a clearly likelier motion.
    """
    if (
        fit.neighbours.correlation < SUSPECT_CORRELATION
        or fit.noise.sigma < MERGED_MODE_NOISE_RATIO * tolerance
    ):
        return fit
    splits = [_split(matches, fit, part) for part in _of_two_parts(matches, fit)]
    found = max(filter(None, splits), key=attrgetter("agreeing"), default=None)
    if found is not None or not is_correlated(fit, tolerance):
        return found or fit
    narrow = fit_with_bounded_noise(
        matches,
        SEARCH_NOISE_BOUND * _independent_variance(fit),
        SEARCH_SAMPLES,
        tolerance,
        options,
        state,
    )
    split = _split(matches, fit, narrow)
    if split is not None:
        return split
    found = refit_general_motion(matches, narrow)
    return found if is_clearly_likelier(found, fit) else fit


def _independent_variance(fit: GeneralMotionFit) -> float:
    """Part of the residual variance that is independent between neighbours.

    The estimate includes the heavy tail of the noise, because matches of a second motion may be in
    the tail.
    """
    sigma = MAD_TO_SIGMA * median(np.abs(fit.residual[fit.probability > 0.5]))
    return max(1.0 - fit.neighbours.correlation, MIN_INDEPENDENT_SHARE) * sigma**2


def _split(
    matches: Matches, fit: GeneralMotionFit, start: GeneralMotionFit
) -> GeneralMotionFit | None:
    """The motion near ``start``, if this motion is the dominant of two motions; else None.

    Most matches must agree with the motion, and the other matches must agree on a second motion.
    """
    variance = _independent_variance(fit)
    residual = np.abs(evaluate_matches(matches, start)[0, fit.probability > 0.5])
    for bound in REFINED_NOISE_BOUNDS:
        if _has_gap(residual, GATE_SIGMA * math.sqrt(bound * variance)):
            found = refit_general_motion(matches.with_noise_up_to(bound * variance), start)
            is_dominant = found.agreeing > DOMINANT_SHARE * fit.agreeing
            if is_dominant and found.neighbours.correlation < MAX_LEFT_BY_SPLIT * min(
                fit.neighbours.correlation, MERGED_MODE_CORRELATION
            ):
                return replace(found, merged_mode_correlation=fit.neighbours.correlation)
            return None
    return None


def _has_gap(residual: np.ndarray, bound: float) -> bool:
    """Whether residuals beyond a bound belong to another motion, not to the tail of the noise."""
    agreeing, near = np.count_nonzero(residual < bound), np.count_nonzero(residual < 2.0 * bound)
    tail, moved = near - agreeing, residual.size - agreeing
    return bool(tail < min(GAP_OF_MOVED * moved, GAP_OF_AGREEING * agreeing))


def _of_two_parts(matches: Matches, fit: GeneralMotionFit) -> Iterator[GeneralMotionFit]:
    """The motions of the two parts of the image that two motions explain best.

    Each part is a set of patches. To first order, the residuals of a part under the best motion of
    that part are ``r + J x`` with ``x = -H^-1 g``, where g is the gradient and H the information of
    the part at the fit. The first split is into the best of some discs and the matches outside that
    disc. Then each patch moves to the part whose motion fits the patch better.
    """
    if len(matches) < 2 * MIN_PART_MATCHES:
        return
    r, J = _linearised(matches, fit)
    rows = np.concatenate([r[:, None], J], axis=1) * np.sqrt(fit.probability)[:, None]
    total, patch = rows.T @ rows, patches_of(matches.rays0)
    moved = _best_disc(matches.rays0, rows, total)
    for _ in range(COARSE_STEPS):
        within = rows[moved].T @ rows[moved]
        apart = (r + _own_steps(np.stack([total - within, within])) @ J.T) ** 2
        gain = np.bincount(patch, fit.probability * (apart[0] - apart[1]))
        before, moved = moved, gain[patch] > 0.0
        if (moved == before).all():
            break
    within = rows[moved].T @ rows[moved]
    left = float(np.sum(_left_over(np.stack([total - within, within]))))
    if left > MAX_LEFT_BY_SPLIT * total[0, 0]:
        return
    for part in (moved, ~moved):
        if np.count_nonzero(part) >= MIN_PART_MATCHES:
            yield refit_general_motion(matches.select(part), fit)


def _best_disc(rays: np.ndarray, rows: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Mask (N,) of the matches in the best disc around one of the rays.

    For the best disc, a motion inside and a motion outside the disc leave the smallest residuals.
    """
    some = np.arange(0, len(rays), max(len(rays) // DISC_MATCHES, 1))
    n, scale = len(some), len(rays) / len(some)
    centers = some[np.arange(DISC_CENTERS) * n // DISC_CENTERS]
    cosines = rays[centers] @ rays[some].T
    outward = np.sort(cosines, axis=1)[:, ::-1]
    rims = outward[:, [round(share * n) - 1 for share in DISC_SHARES]]
    discs = (cosines[:, None] >= rims[:, :, None]).reshape(-1, n)
    products = rows[some, :, None] * rows[some, None, :]  # (n, 6, 6)
    within = scale * (discs.astype(float) @ products.reshape(n, -1)).reshape(-1, 6, 6)
    left = _left_over(within) + _left_over(total - within)
    disc, rim = divmod(int(np.argmin(left)), len(DISC_SHARES))
    return rays @ rays[centers[disc]] >= rims[disc, rim]


def _own_steps(squares: np.ndarray) -> np.ndarray:
    """Gauss-Newton steps (K, 5), from the sums (K, 6, 6) of products of ``[r, J]``."""
    damped = squares[:, 1:, 1:].copy()
    diagonals = np.einsum("kii->ki", damped)  # a view
    diagonals += 1e-9 * diagonals.sum(axis=1, keepdims=True) + 1e-300
    return -np.linalg.solve(damped, squares[:, 1:, :1])[:, :, 0]


def _left_over(squares: np.ndarray) -> np.ndarray:
    """Sums (K,) of squared residuals after the steps of `_own_steps`."""
    return squares[:, 0, 0] + np.sum(squares[:, 1:, 0] * _own_steps(squares), axis=1)


def _linearised(matches: Matches, fit: GeneralMotionFit) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (N,) in units of the noise, and derivatives (N, 5) by ``[dtheta, dbeta]``."""
    t, a, b = fit.direction_cam1_from_cam0, matches.rays0 @ fit.R_cam1_from_cam0.T, matches.rays1
    normal = cross(t, a)
    scale = np.sqrt(matches.precision) / np.maximum(
        np.linalg.norm(normal, axis=1), NEAR_EPIPOLE_RAD
    )
    by_pose = np.hstack([cross(a, cross(b, t)), cross(a, b) @ tangent_basis(t)])
    return scale * np.sum(normal * b, axis=1), scale[:, None] * by_pose
