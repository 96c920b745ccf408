"""Maximum-likelihood rotation of rays without translation."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, sum_kernel
from farpoint._kernels.constants import LANES, LONG_TAIL, PANEL, SUMS_OF_FOUR, TAIL_RATIO
from farpoint._kernels.exponential import lane_log
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.mixture import (
    Densities,
    densities_of,
    sum_of,
    tail_steps_of,
    tail_trials_of,
    update_mixture,
    weight2_of,
    weight_of,
)
from farpoint._kernels.normal_equations import add_four, solve_three_spd
from farpoint._kernels.rotation_residual import rotation_distance2, whitened_residual
from farpoint._kernels.vectors import matrix

__all__ = [
    "evaluate_rotation",
    "refine_rotation",
    "rotation_linearize",
]


@inlined_kernel
def _densities(square: float, precision: float, tail_share: float, prior: float) -> Densities:
    """Densities of a match in two dimensions, divided by the density of the core at 0."""
    return densities_of(
        square * precision, tail_share, tail_share / (TAIL_RATIO * TAIL_RATIO), prior, LONG_TAIL
    )


@sum_kernel
def rotation_linearize(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    H: np.ndarray,
    g: np.ndarray,
    sums: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (3,) and Gauss-Newton matrix ``H`` (3, 3) without translation.

    The values are those of `likelihood.linearize`, but for another residual: the two-dimensional
    ``E^T (b - R a)`` in the tangent plane at ``b``, with the covariance ``E^T (S_b + R S_a R^T)
    E``. ``sums`` (4,) receives three expected numbers (inliers, tail steps, trials of the tail) and
    the sum of the weighted squared residuals.
    """
    rotation = matrix(R)
    precision, tail_share = 1.0 / mixture[0], mixture[2]
    cost = used = inlier = steps = trials = 0.0
    normal = SUMS_OF_FOUR
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            square, row0, row1 = whitened_residual(pairs, at, rotation)
            each = _densities(square, precision, tail_share, share)
            whole = sum_of(each)
            total = whole + clutter
            over = 1.0 / total
            cost -= lane_log(total)
            used += 1.0 if share > 0.0 else 0.0
            inlier += whole * over
            steps += tail_steps_of(each) * over
            trials += tail_trials_of(each, LONG_TAIL) * over
            weight = precision * weight_of(each) * over
            normal = add_four(add_four(normal, weight, row0), weight, row1)
    sums[0], sums[1], sums[2], sums[3] = (
        inlier,
        steps,
        trials,
        _write_normal(normal, H, g) / precision,
    )
    return cost + (prior.size - used) * lane_log(clutter)


@inlined_kernel
def _write_normal(sums: tuple, H: np.ndarray, g: np.ndarray) -> float:
    """Write Gauss-Newton matrix and gradient; returns the weighted sum of squares."""
    aa, ba, bb, ca, cb, cc, g[0], g[1], g[2], square = sums
    H[0, 0], H[0, 1], H[0, 2] = aa, ba, ca
    H[1, 0], H[1, 1], H[1, 2] = ba, bb, cb
    H[2, 0], H[2, 1], H[2, 2] = ca, cb, cc
    return square


@inner_kernel
def refine_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    half_width: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
) -> float:
    """Maximum-likelihood rotation without translation; returns the cost.

    ``mixture`` (3,) holds the noise variance of the core, the share of outliers among all ``count``
    matches, and the share of the tail among inliers. EM updates ``mixture`` in place. Outliers fill
    a disc of radius ``half_width``, in the unit of the noise sigma.
    """
    g, step, sums = np.empty(3), np.empty(3), np.empty(4)
    cost = math.inf
    for _ in range(max_iterations):
        variance, outlier_share = mixture[0], mixture[1]
        clutter = _clutter(variance, outlier_share, half_width)
        cost = rotation_linearize(pairs, prior, R, mixture, clutter, H, g, sums)
        square = sums[3] / max(2.0 * sums[0] - 3.0, 1.0)
        update_mixture(square, sums, float(count), min_variance, 1.0, mixture)
        if not solve_three_spd(H, g, 0.0, step):
            break
        apply_rotation_step(R, -step[0], -step[1], -step[2], R)
        size = 0.0
        for k in range(3):
            size += H[k, k] * step[k] * step[k]
        if size < 1e-6 and abs(mixture[0] - variance) < 1e-3 * variance:
            break
    return cost


@inlined_kernel
def _clutter(variance: float, outlier_share: float, half_width: float) -> float:
    """`mixture.clutter_of` in two dimensions, for outliers that are uniform in a disc."""
    return outlier_share / (1.0 - outlier_share) * 2.0 * variance / (half_width * half_width)


@inner_kernel
def evaluate_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    half_width: float,
    R: np.ndarray,
    mixture: np.ndarray,
    distance2: np.ndarray,
    inlier: np.ndarray,
) -> float:
    """Squared distance of each match as in `rotation_distance2`, and the inlier probability.

    The function returns the share of the information that remains although the mixture component of
    each match is unknown, as `information.information` does.
    """
    rotation_distance2(pairs, R, distance2)
    clutter = _clutter(mixture[0], mixture[1], half_width)
    precision = 1.0 / mixture[0]
    known = missing = 0.0
    for i in range(prior.size):
        each = _densities(distance2[i], precision, mixture[2], prior[i])
        over = 1.0 / (sum_of(each) + clutter)
        inlier[i] = sum_of(each) * over
        weight = weight_of(each) * over
        weight2 = weight2_of(each) * over
        known += weight
        missing += 0.5 * distance2[i] * precision * (weight2 - weight * weight)
    return 1.0 - missing / known if known > 0.0 else 1.0
