"""Hypotheses from five rays: minimal solver, score over all matches, and number of samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inlined_kernel, inner_kernel, sum_kernel
from farpoint._kernels.constants import (
    CONVERGENCE_RATE,
    FIVE_RAY_STEPS,
    LANES,
    LINEAR_STEP_RAD,
    LONG_FLOW_RAD,
    LONGEST_FIVE_RAY_STEP,
    MAX_RESTART_FACTOR,
    PANEL,
    RELATED_CONSENSUS,
    SAMPLE_SIZE,
    START_FAILURE_RATE,
    SUMS_OF_SIX,
    VECTOR_LANES,
)
from farpoint._kernels.epipolar import flow_along, sampson
from farpoint._kernels.normal_equations import (
    add_six,
    predicted_decrease,
    solve_five_spd,
    write_six,
)
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.pose import apply_step
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    cross,
    dot,
    matrix,
    rotate,
    tangent_columns,
    vector,
)

__all__ = ["SearchBudget", "iterations_needed", "score_pose", "solve_five"]


Row = tuple[float, float, float, float, float, float]


class SearchBudget(NamedTuple):
    """Limits of a search: tolerance, confidence, and numbers of samples."""

    tolerance: float
    """Largest residual of a match that is consistent with a pose, in the unit of the noise
    sigma."""
    confidence: float
    """Probability with which the search must find the right mode."""
    min_iterations: int
    """Minimum number of samples."""
    max_iterations: int
    """Maximum number of samples."""


@inlined_kernel
def _cost_each_way(
    pairs: np.ndarray, at: int, R: Matrix, t: Vector, limit: float
) -> tuple[float, float]:
    """Truncated squared residual of a match for ``t`` and for ``-t``."""
    r = sampson(pairs, at, R, t)
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, reach2 = flow_along(m, b, t)
    # If the epipole is between the two rays, the match fits only the twisted pair of the pose.
    cost = where(dot(m, b) < dot(m, t) * dot(b, t), limit, min(r * r, limit))
    ahead, noise = flow * abs(flow), limit * flow_variance(pairs, at) * reach2
    return where(ahead < -noise, limit, cost), where(ahead > noise, limit, cost)


@sum_kernel
def score_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    limit: float,
    best: float,
) -> float:
    """Cost ``sum min(r^2, limit)`` of all matches, for the better sign of ``t``.

    A match costs the full ``limit`` in two cases: the match flows away from ``t`` by more than
    ``sqrt(limit)`` times the standard deviation of the flow for a noise sigma of 1 (the point is
    behind the camera), or the epipole is between the two rays of the match. Matches with prior 0
    cost nothing. If the costs for both signs reach ``best``, the function returns ``best`` early.
    If the opposite sign is better, ``t`` is negated in place.
    """
    rotation, direction = matrix(R), vector(t)
    forward = backward = 0.0
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            ahead, back = _cost_each_way(pairs, panel * PANEL + lane, rotation, direction, limit)
            weight = 1.0 if prior[panel * LANES + lane] > 0.0 else 0.0
            forward += weight * ahead
            backward += weight * back
        if min(forward, backward) >= best:
            return best
    if backward < forward:
        for k in range(3):
            t[k] = -t[k]
        return backward
    return forward


@sum_kernel
def _newton_equations(rays: np.ndarray, R: np.ndarray, t: np.ndarray, normal: np.ndarray) -> None:
    """Normal equations ``normal`` (6, 6) of ``b . (t x m) = 0`` for pairs of rays, ``rays`` (48,).

    Each row ``[m x (b x t), B^T (m x b)]`` is normalised, because the row of a match with short
    flow is small, but must have the same weight as other rows. ``m = R a``, and B is the tangent
    basis at t.
    """
    rotation, direction = matrix(R), vector(t)
    sums = SUMS_OF_SIX
    for lane in range(VECTOR_LANES):
        weight, row = _row(rays, lane, rotation, direction)
        sums = add_six(sums, weight, row)
    write_six(sums, normal)


@inlined_kernel
def _row(rays: np.ndarray, lane: int, R: Matrix, t: Vector) -> tuple[float, Row]:
    """Weight and row of the pair in ``lane``; the last element of the row is ``b . (t x m)``."""
    a = rays[lane], rays[VECTOR_LANES + lane], rays[2 * VECTOR_LANES + lane]
    b = (
        rays[3 * VECTOR_LANES + lane],
        rays[4 * VECTOR_LANES + lane],
        rays[5 * VECTOR_LANES + lane],
    )
    m = rotate(R, a)
    first, second = tangent_columns(t)
    by_t = cross(m, b)
    x, y, z = cross(m, cross(b, t))
    u, v = dot(by_t, first), dot(by_t, second)
    square = x * x + y * y + z * z + u * u + v * v
    return 1.0 / (square + 1e-300), (x, y, z, u, v, dot(t, by_t))


@inner_kernel
def solve_five(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Pose that satisfies the epipolar constraint of five matches, by Newton from ``R, t``.

    This is the iterative five-point solver on the manifold (Lui and Drummond, BMVC 2013, DOI
    10.5244/C.27.116). The result is True if the iteration has converged: the last step was shorter
    than `LINEAR_STEP_RAD`, so that the next step would be within the noise of five rays.
    """
    rays, normal, x = np.empty(SAMPLE_SIZE), np.empty((6, 6)), np.empty(5)
    clear(rays)
    for s in range(5):
        at = address(sample[s])
        for row in range(6):
            rays[row * VECTOR_LANES + s] = pairs[at + row * LANES]
    for _ in range(FIVE_RAY_STEPS):
        _newton_equations(rays, R, t, normal)
        if not solve_five_spd(normal, 0.0, x):
            return False
        _, size2 = predicted_decrease(normal, x)
        size = math.sqrt(size2)
        if not size < 1e3:
            return False
        scale = -LONGEST_FIVE_RAY_STEP / size if size > LONGEST_FIVE_RAY_STEP else -1.0
        for k in range(5):
            x[k] *= scale
        apply_step(R, t, x)
        if size < LINEAR_STEP_RAD:
            return True
    return False


@inner_kernel
def iterations_needed(
    outlier_share: float,
    known: float,
    flow: float,
    has_competing_mode: bool,
    budget: SearchBudget,
) -> int:
    """Number of five-ray samples until the right mode is found with the budget's confidence.

    The inlier share of the best pose is s = ``1 - outlier_share``. 50 % of the samples are drawn
    from all matches, with the inlier share s. The other samples are drawn only from matches
    consistent with a mode, a share ``known`` of all matches. The inlier share of these matches is
    taken as ``min(s / known, 1) min(s / RELATED_CONSENSUS, 1)``. The second factor is for a best
    pose with few inliers: the best pose may be wrong, and its inliers may be outliers of the right
    pose.

    The number is ``log((1 - confidence) / failure) / log(1 - hit)``. ``failure`` is the probability
    that the initial pose leads to a wrong mode. ``failure`` increases with the ``outlier_share``
    and with the square of ``flow``, the median flow in rad after the initial rotation, and is 1
    after a competing mode was found. ``hit`` is the probability that a sample has no outliers and
    converges to the right mode. A sample without outliers converges with a probability of 0.5. A
    long flow and an unreliable initial pose each lower this probability by a factor of up to 2.
    """
    inlier_share = max(1.0 - outlier_share, 0.0)
    square = inlier_share * inlier_share
    away = 1.0 + flow / LONG_FLOW_RAD * flow / LONG_FLOW_RAD
    start_failure = min(START_FAILURE_RATE * away / (square + 1e-9), 1.0)
    failure = 1.0 if has_competing_mode else start_failure
    among_known = min(inlier_share / known, 1.0) * min(inlier_share / RELATED_CONSENSUS, 1.0)
    clean = 0.5 * (inlier_share**5 + among_known**5)
    hit = CONVERGENCE_RATE / (1.0 + failure) / min(away, MAX_RESTART_FACTOR) * clean
    if hit <= 0.0:
        return budget.max_iterations
    needed = math.log(min((1.0 - budget.confidence) / failure, 1.0)) / math.log(1.0 - hit)
    least, most = float(budget.min_iterations), float(budget.max_iterations)
    return int(min(max(needed + 1.0, least), most))
