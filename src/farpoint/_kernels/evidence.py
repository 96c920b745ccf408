"""Labels of the matches; log odds of a direction and a motion; matches beyond a rotation."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.constants import (
    GATE_SIGMA,
    MAX_SIGN_PROBABILITY,
    MIN_OUTLIER_PROBABILITY,
    UNIFORM_WEIGHTS_VARIANCE,
)
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.normal_equations import solve_three_spd
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.rotation import rotation_linearize
from farpoint._kernels.rotation_residual import count_beyond
from farpoint._kernels.vectors import axpby, dot

__all__ = ["count_beyond_rotation", "find_stationary", "label_matches"]


@step_kernel
def label_matches(
    parallax: np.ndarray,
    inlier: np.ndarray,
    sigma: float,
    outlier_share: float,
    labels: np.ndarray,
) -> tuple[int, float, float]:
    """Label the matches; returns the number of non-zero labels and the log odds of sign and motion.

    ``labels`` (N,) receives 0 for an outlier or a match with a parallax of -`GATE_SIGMA` sigma or
    less, 2 for an inlier with a parallax above `GATE_SIGMA` sigma, and 1 for any other match. The
    log odds of the sign are those of the direction against the opposite direction. The log odds of
    the motion are those of the motion against the hypothesis that all matches are outliers;
    ``outlier_share`` is the share of outliers under the motion.

    P is the inlier probability of a match, at most `MAX_SIGN_PROBABILITY`, s is the parallax of the
    match divided by ``sigma``, and Phi is the standard normal distribution function. The match adds
    ``log((P Phi(s) + (1 - P) / 2) / (P Phi(-s) + (1 - P) / 2))`` to the log odds of the sign.
    """
    agreeing = 0
    sign_log_odds = log_odds = 0.0
    for i in range(labels.size):
        p = parallax[i] / sigma
        agrees = inlier[i] > 0.5 and p > -GATE_SIGMA
        agreeing += 1 if agrees else 0
        labels[i] = 0 if not agrees else 2 if p > GATE_SIGMA else 1
        bounded = min(inlier[i], MAX_SIGN_PROBABILITY)
        complement = 0.5 * (1.0 - bounded)
        backward = 0.5 * math.erfc(p / math.sqrt(2.0)) if abs(p) < 8.0 else 0.0 if p > 0.0 else 1.0
        sign_log_odds += math.log(
            (bounded * (1.0 - backward) + complement) / (bounded * backward + complement)
        )
        log_odds += math.log(outlier_share / max(1.0 - inlier[i], MIN_OUTLIER_PROBABILITY))
    return agreeing, sign_log_odds, log_odds


@step_kernel
def count_beyond_rotation(
    pairs: np.ndarray, inlier: np.ndarray, R: np.ndarray, other_R: np.ndarray, distance: float
) -> tuple[int, int]:
    """Number of inliers that the best of three rotations does not explain, and of all inliers.

    A rotation explains an inlier if the distance of the match from the prediction of the rotation
    is at most ``distance``, in the unit of the noise sigma. ``inlier`` (N,) is 1 or 0. The three
    rotations are ``R``, ``other_R``, and the least-squares rotation, which is computed by one
    Gauss-Newton step from ``R``. The best of the three rotations is the one that explains the most
    inliers. The least-squares rotation also explains flow that ``R`` leaves to a translation, but
    is not robust to outliers. Both numbers are 0 if the inliers fix no least-squares rotation.
    """
    step, nearest = np.empty(3), np.empty((3, 3))
    H, g, sums, mixture = np.empty((3, 3)), np.empty(3), np.empty(4), np.empty(3)
    mixture[0], mixture[1], mixture[2] = UNIFORM_WEIGHTS_VARIANCE, 0.0, 0.0
    rotation_linearize(pairs, inlier, R, mixture, 1e-300, H, g, sums)
    if not solve_three_spd(H, g, 0.0, step):
        return 0, 0
    apply_rotation_step(R, -step[0], -step[1], -step[2], nearest)
    total = 0
    for i in range(inlier.size):
        total += 1 if inlier[i] > 0.5 else 0
    limit = distance * distance
    fewest = min(count_beyond(pairs, inlier, R, limit), count_beyond(pairs, inlier, other_R, limit))
    return int(min(fewest, count_beyond(pairs, inlier, nearest, limit))), total


@kernel
def find_stationary(pairs: np.ndarray, within: float, stationary: np.ndarray) -> int:
    """Mark the ``stationary`` matches (N,); returns the number of stationary matches.

    The flow of a stationary match is shorter than ``within``, in the unit of the noise sigma.
    """
    count = 0
    for i in range(stationary.size):
        at = address(i)
        flow = axpby(1.0, ray1(pairs, at), -1.0, ray0(pairs, at))
        stationary[i] = dot(flow, flow) < within * within * flow_variance(pairs, at)
        count += 1 if stationary[i] else 0
    return count
