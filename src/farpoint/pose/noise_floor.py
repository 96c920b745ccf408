"""Noise floor: variance that all matches have in addition to their given covariances.

The covariances of a tracker contain only the image noise within the tracked windows. Noise of other
causes (interpolation, blur, curved surfaces) is the same for all tracks. This noise matters most
for tracks with the smallest covariances: without a floor these tracks have too much weight.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.constants import EM_ROUNDS, MIN_NOISE_MATCHES, STUDENT_FREEDOM
from farpoint._kernels.noise_floor import floor_likelihoods
from farpoint.pose.constants import NOISE_FLOORS
from farpoint.pose.general_motion import GeneralMotionFit, Start, evaluate_matches
from farpoint.pose.matches import Matches

__all__ = ["noise_floor"]


def noise_floor(matches: Matches, fit: GeneralMotionFit | Start) -> float:
    """Variance that all matches have in common, divided by the median of the given variances.

    An inlier with the given variance ``v`` across its epipolar line has a residual ``e`` with the
    variance ``a (v + floor)``. The factor ``a`` is the same for all inliers. The result is the
    likeliest floor of a grid of values under Student's distribution. It is 0 without given noise,
    and for few inliers.
    """
    if matches.given_noise is None:
        return 0.0
    residual, _, probability = evaluate_matches(matches, fit)
    inlier = (probability > 0.5) & (np.abs(residual) > 1e-9)
    if np.count_nonzero(inlier) < MIN_NOISE_MATCHES:
        return 0.0
    squares = evaluate_matches(matches.given_noise.uniform(), fit)[0, inlier] ** 2
    # The residual for equal variances, squared, divided by the squared residual for the given
    # variances, is the given variance v across the epipolar line.
    variances = squares / residual[inlier] ** 2
    log_likelihood = floor_likelihoods(squares, variances, NOISE_FLOORS, STUDENT_FREEDOM, EM_ROUNDS)
    # Of floors that are equally likely up to rounding, the smallest is taken: with equal given
    # covariances all floors are equally likely, and the result is 0.
    return float(NOISE_FLOORS[np.argmax(np.round(log_likelihood, 6))])
