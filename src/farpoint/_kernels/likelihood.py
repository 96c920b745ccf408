"""Likelihood of a pose given matches with outliers, and its normal equations."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel, sum_kernel
from farpoint._kernels.constants import (
    CHEIRALITY_SIGMA,
    CHEIRALITY_WEIGHT,
    LANES,
    MAX_CHEIRALITY_PENALTY,
    MIN_PENALISED_INLIERS,
    PANEL,
    SUMS_OF_SIX,
)
from farpoint._kernels.epipolar import (
    flow_along,
    parallax_variance,
    sampson,
    sampson_jacobian,
    shift_jacobian,
)
from farpoint._kernels.exponential import lane_log
from farpoint._kernels.mixture import (
    cheirality_penalty,
    clutter_at,
    clutter_of,
    densities,
    mixture_cost,
    sum_of,
    tail_steps_of,
    tail_trials_of,
    weight_of,
)
from farpoint._kernels.normal_equations import add_six, add_to_square, write_six
from farpoint._kernels.pairs import ray0, ray1
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import Matrix, Vector, matrix, rotate, tangent_columns, vector

__all__ = ["evaluate_pose", "evaluate_residuals", "linearize"]


@sum_kernel
def linearize(
    point: LinearisationPoint, soft_cheirality: bool, normal: np.ndarray, shares: np.ndarray
) -> float:
    """Robust cost of all matches and its normal equations.

    The cost is ``-sum log(prior (core + tail) + clutter)``, with the densities of `mixture`, which
    are divided by the density of the core at a residual of 0. J is the Jacobian (N, 5) of the
    residuals r, and W is the diagonal matrix of the robust weights. ``normal`` (6, 6) receives
    ``[J r]^T W [J r]``: the Gauss-Newton matrix, the gradient in the last column, and the weighted
    sum of squares in the lower right corner. With ``soft_cheirality`` the parallaxes that have a
    penalty are residuals, too. ``shares`` (4,) receives the expected numbers of inliers, of tail
    steps (`tail_steps_of`), of trials of the tail (`tail_trials_of`), and of outliers from repeated
    structure.
    """
    pairs, prior, clutter = (
        point.pairs,
        point.prior,
        clutter_of(point.mixture, point.outlier_half_width),
    )
    rotation, direction = matrix(point.R), vector(point.t)
    basis = tangent_columns(direction)
    precision, tail_share = 1.0 / point.mixture[0], point.mixture[2]
    cost = inlier = steps = trials = repeated = penalised = 0.0
    sums = SUMS_OF_SIX
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            row = sampson_jacobian(pairs, at, rotation, direction, basis)
            _, _, _, _, _, residual = row
            each = densities(
                pairs,
                at,
                rotation,
                direction,
                residual,
                precision,
                tail_share,
                share,
                point.long_tail,
            )
            whole = sum_of(each)
            outlier, near = clutter_at(clutter, residual)
            total = whole + outlier
            over = 1.0 / total
            used = 1.0 if share > 0.0 else 0.0
            cost -= used * lane_log(total)
            inlier += whole * over
            steps += tail_steps_of(each) * over
            trials += tail_trials_of(each, point.long_tail) * over
            repeated += used * near * over
            penalty = cheirality_penalty(pairs, at, rotation, direction, precision)
            penalised += where(penalty > 0.0, whole * over, 0.0)
            sums = add_six(sums, precision * weight_of(each) * over, row)
    write_six(sums, normal)
    if soft_cheirality and penalised > MIN_PENALISED_INLIERS:
        _add_cheirality_residuals(point, normal)
    shares[0], shares[1], shares[2], shares[3] = inlier, steps, trials, repeated
    return cost


@inner_kernel
def _add_cheirality_residuals(point: LinearisationPoint, normal: np.ndarray) -> None:
    """Add cheirality penalties to the normal equations of `linearize`, as residuals.

    The residual is ``s + 2.5`` for a parallax of s sigma, s < -2.5. The weight is
    `CHEIRALITY_WEIGHT` times the probability of the core times ``(1 - tail_share)^2``. The last
    factor reduces the weight if the tail is heavy. With a heavy tail, matches have large errors
    along their epipolar lines in both directions, but only the errors in one direction have a
    penalty.
    """
    pairs, prior, clutter = (
        point.pairs,
        point.prior,
        clutter_of(point.mixture, point.outlier_half_width),
    )
    rotation, direction = matrix(point.R), vector(point.t)
    basis = tangent_columns(direction)
    precision, tail_share = 1.0 / point.mixture[0], point.mixture[2]
    beyond2 = np.empty(prior.size)
    _evaluate_penalties(pairs, rotation, direction, precision, beyond2)
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            if not 0.0 < beyond2[panel * LANES + lane] < MAX_CHEIRALITY_PENALTY:
                continue
            residual = sampson(pairs, at, rotation, direction)
            each = densities(
                pairs,
                at,
                rotation,
                direction,
                residual,
                precision,
                tail_share,
                share,
                point.long_tail,
            )
            core, _, _, _ = each
            outlier, _ = clutter_at(clutter, residual)
            inlier = core / (sum_of(each) + outlier)
            weight = (
                CHEIRALITY_WEIGHT * precision * (1.0 - tail_share) * (1.0 - tail_share) * inlier
            )
            x, y, z, u, v, shift = shift_jacobian(pairs, at, rotation, direction, basis)
            beyond = shift + CHEIRALITY_SIGMA / math.sqrt(precision)
            add_to_square(weight, (x, y, z, u, v, beyond), normal)


@inner_kernel
def _evaluate_penalties(
    pairs: np.ndarray, R: Matrix, t: Vector, precision: float, beyond2: np.ndarray
) -> None:
    """Write the `mixture.cheirality_penalty` of each match to ``beyond2``."""
    for panel in range(beyond2.size // LANES):
        for lane in range(LANES):
            at = panel * PANEL + lane
            beyond2[panel * LANES + lane] = cheirality_penalty(pairs, at, R, t, precision)


@step_kernel
def evaluate_pose(matches: PackedMatches, pose: Pose, shares: np.ndarray) -> float:
    """Negative log likelihood of a pose, with normal equations and ``shares`` as in `linearize`."""
    variance, outlier_share, half_width, long_tail = (
        pose.mixture[0],
        pose.mixture[1],
        matches.outlier_half_width,
        matches.long_tail,
    )
    point = LinearisationPoint(
        matches.pairs, matches.prior, pose.R, pose.t, pose.mixture, half_width, long_tail
    )
    cost = linearize(point, matches.soft_cheirality, pose.normal, shares)
    return cost + matches.total * mixture_cost(variance, outlier_share)


@inlined_kernel
def _evaluate_match(
    pairs: np.ndarray,
    at: int,
    R: Matrix,
    t: Vector,
    precision: float,
    tail_share: float,
    prior: float,
    long_tail: float,
) -> tuple[float, float, float]:
    """Residual and parallax of a match as in `evaluate_residuals`, and sum of its `densities`."""
    residual = sampson(pairs, at, R, t)
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    variance = parallax_variance(pairs, at, R, m, t)
    each = densities(pairs, at, R, t, residual, precision, tail_share, prior, long_tail)
    return residual, flow / math.sqrt(variance + 1e-300), sum_of(each)


@kernel
def evaluate_residuals(
    point: LinearisationPoint, residual: np.ndarray, parallax: np.ndarray, inlier: np.ndarray
) -> None:
    """Evaluate residual, parallax and inlier probability of each match at a pose.

    ``residual`` receives the Sampson residual, in the unit of the noise sigma. ``parallax``
    receives the signed shift along the epipolar line, positive towards the direction, divided by
    the standard deviation of this shift for a noise sigma of 1. ``inlier`` receives the inlier
    probability.
    """
    pairs, prior, clutter = (
        point.pairs,
        point.prior,
        clutter_of(point.mixture, point.outlier_half_width),
    )
    rotation, direction = matrix(point.R), vector(point.t)
    precision, tail_share = 1.0 / point.mixture[0], point.mixture[2]
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, i = panel * PANEL + lane, panel * LANES + lane
            residual[i], parallax[i], density = _evaluate_match(
                pairs, at, rotation, direction, precision, tail_share, prior[i], point.long_tail
            )
            outlier, _ = clutter_at(clutter, residual[i])
            inlier[i] = density / (density + outlier)
