"""The motion of most matches, where the likeliest one lies between that and another.

What moves by itself has a motion of its own, and so have windows that were taken for the next ones.
Between it and that of the camera goes a third, which explains all matches with more noise, and may
be the likeliest by far. But its residuals are no noise: neighbours are off alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint._kernels.plausible import BAND_SIGMA
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.covariance import moving_covariance
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import Coherence
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.small import rotation_vector

__all__ = ["BETWEEN", "majority_motion"]

# Correlation of neighbours' residuals from which on a motion may lie between two.
BETWEEN = 0.65
# Share of the variance that is its own at the least: two of one point share all of it.
LEAST_OWN = 0.05
# Noise that is believed while the motion of most is searched for, over what each match has of its
# own: what neighbours differ by is more where they belong to two motions.
NARROW = 0.125
# Samples that are drawn for it at the most: enough where half of the matches are its own.
SAMPLES = 400
# Least share of the matches that it has.
LEAST_SHARE = 1.0 / 3.0
# What another motion has moved is off by more than twice what still agrees, but for this share.
BETWEEN_BOTH = 1.0 / 3.0
# Squared Mahalanobis distance of two motions from which on they are not one: chi-square of five
# degrees of freedom exceeds it once in a thousand times.
APART2 = 20.5


def majority_motion(
    matches: Matches,
    fit: MovingFit,
    coherence: Coherence,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """The fit; or the motion of most of its matches, if it lies between that and another.

    ``coherence`` is that of the fit, as of `coherence_of`. What neighbours do not share is the
    noise that each match has of its own. With no more than that, either motion is likelier than the
    one between. Errors that are smooth over the image, of a lens or of tracks, are as smooth with
    less noise, and lead to no other motion: then the fit stays, by which all matches are heard.
    """
    if coherence.beside < BETWEEN:
        return fit
    own = max(1.0 - coherence.beside, LEAST_OWN) * fit.noise.variance
    effort = replace(options, max_iterations=min(options.max_iterations, SAMPLES))
    narrow = fit_moving(_with_noise_up_to(NARROW * own, matches), tolerance, effort, state)
    found = refit_moving(_with_noise_up_to(own, matches), narrow)
    is_of_many = found.agreeing > LEAST_SHARE * fit.agreeing
    return found if is_of_many and _is_apart(found) and _are_two(fit, found) else fit


def _is_apart(fit: MovingFit) -> bool:
    """Whether the matches that disagree are not just the tail of those that agree."""
    off = np.abs(fit.residual) / (BAND_SIGMA * fit.noise.sigma)
    disagreeing, far_off = int(np.count_nonzero(off > 1.0)), int(np.count_nonzero(off > 2.0))
    return disagreeing - far_off < BETWEEN_BOTH * disagreeing


def _with_noise_up_to(variance: float, matches: Matches) -> Matches:
    return replace(matches, max_variance=max(variance, matches.min_variance))


def _are_two(fit: MovingFit, found: MovingFit) -> bool:
    """Whether the motion found is none that the matches of the fit allow."""
    direction = fit.direction_cam1_from_cam0
    if found.direction_cam1_from_cam0 @ direction < 0.0:
        return True
    turn = rotation_vector(found.R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T)
    apart = np.array([*turn, *(tangent_basis(direction).T @ found.direction_cam1_from_cam0)])
    return bool(apart @ np.linalg.solve(moving_covariance(fit), apart) > APART2)
