"""The likelihood of a pose given matches of which some are wrong, and its maximum.

A match is good, with a normal residual of variance ``variance``; or poor, with `POOR` times its
sigma; or wrong, and anywhere in a strip of half-width ``spread`` about the epipolar line (all in
units of the noise). The shares of poor matches among the right ones and of wrong ones among all are
estimated along, so that normal noise is treated as such and heavy tails lose only what they must.

A right match flows towards the direction. Noise can make a far one retreat; beyond `FAR_SIGMA` the
density of right matches falls off as that noise does. Up to there it is flat, for rotation can
imitate parallax, and any slope would pull at the rotation.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, sum_kernel
from farpoint._kernels.epipolar import (
    flow_along,
    parallax_variance,
    sampson,
    sampson_jacobian,
)
from farpoint._kernels.exponential import exp_and_eighth, lane_log
from farpoint._kernels.linear import apply_rotation_step, copy, solve_five_spd
from farpoint._kernels.pairs import LANES, PANEL, ray0, ray1
from farpoint._kernels.vectors import combine, dot, matrix, rotate, tangent_columns, vector

__all__ = [
    "FAR_SIGMA",
    "POOR",
    "apply_step",
    "clutter_density",
    "densities",
    "explain",
    "linearize",
    "mixture_cost",
    "refine_pose",
]

# Sigma of a poor match over that of a good one.
POOR = math.sqrt(8.0)
# Share of poor matches that is usual, with the weight of so many matches: among few, chance alone
# makes some look poor, and the others better than they are.
FEW_POOR = 0.01
USUAL = 20.0
# Retreat along its epipolar line that noise can cause of a far point, in sigma.
FAR_SIGMA = 3.0


@kernel
def apply_step(R: np.ndarray, t: np.ndarray, x: np.ndarray) -> None:
    """Move the pose by ``x = [dtheta (3), dbeta (2)]`` in place."""
    apply_rotation_step(R, x[0], x[1], x[2], R)
    first, second = tangent_columns(vector(t))
    moved = combine(1.0, vector(t), 1.0, combine(x[3], first, x[4], second))
    scale = 1.0 / math.sqrt(dot(moved, moved))
    t[0], t[1], t[2] = scale * moved[0], scale * moved[1], scale * moved[2]


@kernel
def clutter_density(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of inliers at r = 0."""
    return wrong / (1.0 - wrong) * math.sqrt(2.0 * math.pi * variance) / (2.0 * spread)


@inner_kernel
def mixture_cost(variance: float, wrong: float) -> float:
    """What each match adds to the cost by the noise alone."""
    return 0.5 * math.log(variance) - math.log(1.0 - wrong)


@inlined_kernel
def densities(
    pairs: np.ndarray,
    at: int,
    R: tuple,
    t: tuple,
    residual: float,
    precision: float,
    poor: float,
    prior: float,
) -> tuple[float, float]:
    """Density of the match at this address, if good and if poor, over that of a good one at 0."""
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    shift2 = flow * flow * precision / (parallax_variance(pairs, at, R, m, t) + 1e-300)
    retreat = max(shift2 - FAR_SIGMA * FAR_SIGMA, 0.0) if flow < 0.0 else 0.0
    whole, eighth = exp_and_eighth(0.5 * (residual * residual * precision + retreat))
    return prior * (1.0 - poor) * whole, prior * poor / POOR * eighth


@sum_kernel
def linearize(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    normal: np.ndarray,
    shares: np.ndarray,
) -> float:
    """Robust cost of all matches, with its normal equations.

    The cost is ``-sum log(prior (good + poor) + clutter)``, where ``prior`` scales the share of
    right matches one by one (0 leaves a match out) and ``clutter``, positive, is the density of
    wrong matches over that of right ones. With J the Jacobian (N, 5) of the residuals r, ``normal``
    (6, 6) receives ``[J r]^T W [J r]``: the Gauss-Newton matrix, the gradient in its last column,
    the squares in its corner. ``shares`` (2,) receives the expected number of right matches, and of
    poor ones among them.
    """
    turn, towards = matrix(R), vector(t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / mixture[0], mixture[2]
    cost = used = right = doubtful = 0.0
    # Each sum has a register of its own: in a loop over indices they would wait for one another.
    n00 = n10 = n11 = n20 = n21 = n22 = n30 = n31 = n32 = n33 = 0.0
    n40 = n41 = n42 = n43 = n44 = n50 = n51 = n52 = n53 = n54 = n55 = 0.0
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            r, j0, j1, j2, j3, j4 = sampson_jacobian(pairs, at, turn, towards, basis)
            good, fair = densities(pairs, at, turn, towards, r, precision, poor, share)
            total = good + fair + clutter
            over = 1.0 / total
            cost -= lane_log(total)
            used += 1.0 if share > 0.0 else 0.0
            right += (good + fair) * over
            doubtful += fair * over
            weight = precision * (good + fair * 0.125) * over
            w0, w1, w2, w3, w4 = weight * j0, weight * j1, weight * j2, weight * j3, weight * j4
            n00, n10, n20, n30, n40 = (
                n00 + w0 * j0,
                n10 + w0 * j1,
                n20 + w0 * j2,
                n30 + w0 * j3,
                n40 + w0 * j4,
            )
            n11, n21, n31, n41 = n11 + w1 * j1, n21 + w1 * j2, n31 + w1 * j3, n41 + w1 * j4
            n22, n32, n42 = n22 + w2 * j2, n32 + w2 * j3, n42 + w2 * j4
            n33, n43, n44 = n33 + w3 * j3, n43 + w3 * j4, n44 + w4 * j4
            n50, n51, n52, n53, n54 = (
                n50 + w0 * r,
                n51 + w1 * r,
                n52 + w2 * r,
                n53 + w3 * r,
                n54 + w4 * r,
            )
            n55 += weight * r * r
    fill_row(normal[0], n00, n10, n20, n30, n40, n50)
    fill_row(normal[1], n10, n11, n21, n31, n41, n51)
    fill_row(normal[2], n20, n21, n22, n32, n42, n52)
    fill_row(normal[3], n30, n31, n32, n33, n43, n53)
    fill_row(normal[4], n40, n41, n42, n43, n44, n54)
    fill_row(normal[5], n50, n51, n52, n53, n54, n55)
    shares[0], shares[1] = right, doubtful
    return cost + (prior.shape[0] - used) * lane_log(clutter)


@inner_kernel
def fill_row(row: np.ndarray, a: float, b: float, c: float, d: float, e: float, f: float) -> None:
    """Write six numbers."""
    row[0], row[1], row[2], row[3], row[4], row[5] = a, b, c, d, e, f


@inner_kernel
def update_mixture(
    square: float, total: float, poor: float, count: float, minimum: float, mixture: np.ndarray
) -> None:
    """EM step of variance, share of wrong and share of poor matches, from weighted sums."""
    mixture[0] = max(square, minimum)
    mixture[1] = min(max(1.0 - total / count, 0.005), 0.95)
    mixture[2] = min((poor + FEW_POOR * USUAL) / (total + USUAL), 0.5)


@kernel
def refine_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    precision: float,
    max_iterations: int,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
) -> float:
    """Maximum-likelihood pose, with its noise by EM; returns the negative log likelihood.

    Gauss-Newton with the full derivative of the residual. ``mixture`` (3,) holds the variance of
    good matches, the share of wrong ones among all ``count`` and that of poor ones, in and out. It
    ends at a pose from which a step promises less than ``precision``, in the unit of the log
    likelihood; ``normal`` (6, 6) receives the normal equations there.
    """
    g, x, shares = np.empty(5), np.empty(5), np.empty(2)
    kept_R, kept_t, kept = np.empty((3, 3)), np.empty(3), np.empty((6, 6))
    lowest = math.inf
    damping = 0.0
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = clutter_density(variance, wrong, spread)
        cost = linearize(pairs, prior, R, t, mixture, clutter, normal, shares)
        cost += count * mixture_cost(variance, wrong)
        # EM with unbiased variance may climb a little; a step that climbs more has gone astray.
        if cost > lowest + 0.5:
            copy(kept_R, R)
            copy(kept_t, t)
            copy(kept, normal)
            damping = max(100.0 * damping, 1e-2)
        else:
            lowest = cost
            copy(R, kept_R)
            copy(t, kept_t)
            copy(normal, kept)
            damping *= 0.1
            square = normal[5, 5] * variance / max(shares[0] - 5.0, 1.0)
            update_mixture(square, shares[0], shares[1], count, min_variance, mixture)
        for k in range(5):
            g[k] = normal[k, 5]
        while not solve_five_spd(normal, g, damping, x) and damping < 1e6:
            damping = max(10.0 * damping, 1e-9)
        if not damping < 1e6:
            break
        decrease = square_size = 0.0
        for k in range(5):
            decrease += g[k] * x[k]
            square_size += x[k] * x[k]
        settled = abs(mixture[0] - variance) < max(0.01, precision) * variance
        if settled and decrease < precision:
            break
        scale = -1.0 if square_size < 0.09 else -0.3 / math.sqrt(square_size)
        for k in range(5):
            x[k] *= scale
        apply_step(R, t, x)
    # The last step was not judged: the pose before it was.
    copy(kept_R, R)
    copy(kept_t, t)
    copy(kept, normal)
    return lowest


@kernel
def explain(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    residual: np.ndarray,
    parallax: np.ndarray,
    right: np.ndarray,
) -> None:
    """What a pose makes of each match.

    ``residual`` receives the Sampson residual, ``parallax`` the signed shift towards the direction
    along the epipolar line in units of its own noise, both for unit noise, and ``right`` the
    probability of being right.
    """
    turn, towards = matrix(R), vector(t)
    precision, poor = 1.0 / mixture[0], mixture[2]
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at, i = panel * PANEL + lane, panel * LANES + lane
            r = sampson(pairs, at, turn, towards)
            m, b = rotate(turn, ray0(pairs, at)), ray1(pairs, at)
            flow, _ = flow_along(m, b, towards)
            variance = parallax_variance(pairs, at, turn, m, towards)
            good, fair = densities(pairs, at, turn, towards, r, precision, poor, prior[i])
            residual[i] = r
            parallax[i] = flow / math.sqrt(variance + 1e-300)
            right[i] = (good + fair) / (good + fair + clutter)
