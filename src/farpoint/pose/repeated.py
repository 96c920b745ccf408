"""Repeated structure, one window taken for the next: the motion beside it, not the one between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint._kernels.mixture import REPEATED_WITHIN
from farpoint._kernels.repeated import beyond_chance
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.covariance import moving_covariance
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import COHERENT, coherence_of, sharing_of
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.small import rotation_vector

__all__ = ["beside_repeated"]

# Fewer repeated matches make no structure.
MANY = 10.0
# Squared Mahalanobis distance of two motions from which on they are not one: chi-square of five
# degrees of freedom exceeds it once in a thousand times.
APART2 = 20.5
# Correlation of neighbours' residuals up to which they are noise.
WHITE = 0.15
# Variances that are tried, over the one that was found, and the least share of its matches that
# agree with a motion of so little noise.
NARROWER = tuple(2.0**-k for k in range(2, 8))
LEAST_SHARE = 1.0 / 3.0


def beside_repeated(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> tuple[MovingFit, bool]:
    """The fit; or where neighbours are off alike, one with less noise where they are not.

    And whether they still are: then no other was found.

    Between right matches and repeated ones goes a motion that explains both, with more noise, and
    since many are repeated alike it may be the likeliest. But its residuals are no noise. Those of
    the right motion are, and it is found where no more noise is believed than it needs. Where that
    is no other motion, neighbours share their errors for another reason, and all matches are heard.
    """
    if not _may_lie_between(matches, fit, tolerance) or coherence_of(fit) < COHERENT:
        return fit, False
    for share in NARROWER:
        narrow = replace(matches, max_variance=share * fit.noise.variance)
        found = fit_moving(narrow, tolerance, options, state)
        if found.agreeing > LEAST_SHARE * fit.agreeing and coherence_of(found) < WHITE:
            return (_widened(narrow, found) if _are_two(fit, found) else fit), False
    return fit, True


def _may_lie_between(matches: Matches, fit: MovingFit, tolerance: float) -> bool:
    """Whether the noise is that of no match, or wrong ones are near their lines for a reason."""
    noise, motion = fit.noise, (fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0)
    if noise.sigma >= tolerance:
        return True
    if len(matches) * noise.wrong * noise.repeated < MANY:
        return False
    within = matches.spread / REPEATED_WITHIN
    return beyond_chance(matches.pairs, fit.probability, *motion, within) >= MANY


def _are_two(fit: MovingFit, found: MovingFit) -> bool:
    """Whether the motion found is none that the matches of the fit allow, with what they share."""
    direction = fit.direction_cam1_from_cam0
    if found.direction_cam1_from_cam0 @ direction < 0.0:
        return True
    turn = rotation_vector(found.R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T)
    apart = np.array([*turn, *(tangent_basis(direction).T @ found.direction_cam1_from_cam0)])
    covariance = sharing_of(fit) * moving_covariance(fit)
    return bool(apart @ np.linalg.solve(covariance, apart) > APART2)


def _widened(matches: Matches, fit: MovingFit) -> MovingFit:
    """With as much noise as there is while neighbours are not off alike."""
    while fit.noise.variance > 0.99 * matches.max_variance:
        matches = replace(matches, max_variance=2.0 * matches.max_variance)
        wider = refit_moving(matches, fit)
        if coherence_of(wider) > WHITE:
            break
        fit = wider
    return fit
