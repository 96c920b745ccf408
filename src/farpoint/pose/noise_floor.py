"""Noise floor: variance that all matches have in addition to their given covariances.

The covariances of a tracker contain the noise within its windows. Noise of other causes
(interpolation, blur, curved surfaces) is the same for all tracks and matters most for tracks with
the smallest covariances: without a floor these tracks have too much weight.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.noise_floor import floor_likelihoods
from farpoint.pose.general_motion import GeneralMotionFit, Start, evaluate_matches
from farpoint.pose.matches import Matches

__all__ = ["noise_floor"]

# Floors to choose from, as variances over the median of the given ones.
FLOORS = np.array([0.0, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 13.0, 50.0])
# Degrees of freedom of the residuals' distribution: heavier tails than the normal one's.
FREEDOM = 5.0
ROUNDS = 8
# Least number of matches for a floor.
LEAST_MATCHES = 30


def noise_floor(matches: Matches, fit: GeneralMotionFit | Start) -> float:
    """Variance that all matches have in common, over the median of the given variances.

    The residuals ``e`` of inliers, with given variances ``v`` across the epipolar lines, have the
    variance ``a (v + floor)`` with a common factor ``a``. The result is the floor, from a grid of
    values, that is most likely by Student's distribution; 0 without given noise, and for few
    matches.
    """
    if matches.given_noise is None:
        return 0.0
    residual, _, probability = evaluate_matches(matches, fit)
    inlier = (probability > 0.5) & (np.abs(residual) > 1e-9)
    if np.count_nonzero(inlier) < LEAST_MATCHES:
        return 0.0
    squares = evaluate_matches(matches.given_noise.uniform(), fit)[0, inlier] ** 2
    # The same residual, in units of the common noise and in units of the given noise.
    variances = squares / residual[inlier] ** 2
    log_likelihood = floor_likelihoods(squares, variances, FLOORS, FREEDOM, ROUNDS)
    # Of floors equally likely up to rounding, the least: equal given covariances have no floor.
    return float(FLOORS[np.argmax(np.round(log_likelihood, 6))])
