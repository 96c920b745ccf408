"""Comparison of a hypothesis with the best pose: local optimisation, Laplace factor, selection."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel
from farpoint._kernels.constants import (
    CHANCE_MATCHES,
    COARSE_STEPS,
    COARSE_TOLERANCE,
    COS_DIFFERENT_MODE,
    GATE_SIGMA,
    KEPT_SIZE,
    LANES,
    MAX_SEARCHED,
    MIN_SHARE,
    MODE_MARGIN,
    PANEL,
    PLANAR_MARGIN,
    REMAINING_GAIN_FACTOR,
    SAME_MODE_LOG_RATIO,
    START_OUTLIER_SHARE,
    START_REPEATED_SHARE,
    START_TAIL_SHARE,
    STATE_PREDICTED_DECREASE,
)
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.normal_equations import determinant_beside_one
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose, linearisation_point
from farpoint._kernels.refinement import advance, begin, finish, refine_pose
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import dot, matrix, rotate, tangent_columns, vector

__all__ = [
    "compare_hypothesis",
    "default_noise",
    "initial_noise",
    "is_same_mode",
    "is_secondary_mode",
    "laplace_factor",
    "mark_consistent",
    "outlier_share_of",
    "planar_margin",
    "refine",
    "refine_if_competitive",
]


@step_kernel
def laplace_factor(normal: np.ndarray) -> float:
    """Laplace (Occam) factor ``1/2 log det(I + G)``.

    The factor is the logarithm of the ratio of two likelihoods: the likelihood at the maximum, and
    the likelihood averaged over the prior of the pose, whose sigma is one radian. G is the
    Gauss-Newton matrix, the first five rows and columns of ``normal``. For any five matches there
    is a pose without residuals, which may fit a sixth match by chance. The small residuals raise
    the likelihood of this pose at a narrow maximum, and the Laplace factor lowers the likelihood
    again. The factor is infinite if ``I + G`` is not positive definite.
    """
    determinant, positive = determinant_beside_one(normal)
    return 0.5 * math.log(determinant) if positive else math.inf


@step_kernel
def refine(matches: PackedMatches, steps: int, pose: Pose) -> None:
    """Refine a pose, and add the Laplace factor to its cost."""
    refine_pose(matches, COARSE_TOLERANCE, steps, pose)
    _add_laplace_factor(matches, pose)


@step_kernel
def _add_laplace_factor(matches: PackedMatches, pose: Pose) -> None:
    """Add the `laplace_factor` to the cost of a pose.

    If the share of inliers is at most `MIN_SHARE`, the cost is set to at least the cost of a model
    in which all matches are uniform outliers. Without this lower bound, a pose without inliers
    could have a lower cost because of outliers near its epipolar lines, which the mixture takes as
    repeated structure.
    """
    pose.cost[0] += laplace_factor(pose.normal)
    if not _has_inliers(pose):
        none = matches.total * math.log(2.0 * matches.outlier_half_width / math.sqrt(2.0 * math.pi))
        pose.cost[0] = max(pose.cost[0], none)


@step_kernel
def _has_inliers(pose: Pose) -> bool:
    """Whether the share of inliers exceeds `MIN_SHARE`."""
    return 1.0 - pose.mixture[1] > MIN_SHARE


@step_kernel
def default_noise(tolerance: float, mixture: np.ndarray) -> None:
    """Default initial noise parameters of EM; the noise sigma is ``tolerance / GATE_SIGMA``."""
    mixture[0] = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[1] = START_OUTLIER_SHARE
    mixture[2] = START_TAIL_SHARE
    mixture[3] = START_REPEATED_SHARE


@step_kernel
def initial_noise(
    matches: PackedMatches, best: Pose, tolerance: float, mixture: np.ndarray
) -> None:
    """Initial noise parameters of EM: those of the best pose, or those of `default_noise`.

    The parameters of the best pose are used if the pose has more than `CHANCE_MATCHES` inliers and
    a smaller variance than `default_noise`. At a wrong local minimum all matches count as inliers
    with a large variance, and from such a variance EM does not converge to another minimum.
    """
    default_noise(tolerance, mixture)
    has_sample = (1.0 - best.mixture[1]) * matches.total > CHANCE_MATCHES
    if has_sample and best.mixture[0] < mixture[0]:
        copy(best.mixture, mixture)


@inner_kernel
def outlier_share_of(matches: PackedMatches, best: Pose, tolerance: float) -> float:
    """Share of outliers at the best pose: by the mixture or by the tolerance, whichever is larger.

    At a wrong local minimum all matches count as inliers with a large variance in the mixture. The
    share of matches with residuals beyond the tolerance does not depend on this variance.
    """
    consistent = np.empty(matches.prior.size)
    clear(consistent)
    mark_consistent(matches.pairs, best.R, best.t, tolerance, consistent)
    within = 0.0
    for i in range(matches.total):
        within += consistent[i]
    return max(best.mixture[1], 1.0 - within / matches.total)


@inner_kernel
def mark_consistent(
    pairs: np.ndarray, R: np.ndarray, t: np.ndarray, tolerance: float, consistent: np.ndarray
) -> None:
    """Write 1 to ``consistent`` for each match whose residual is within the tolerance.

    The values of the other matches do not change. ``consistent`` has the length of the panels,
    filler included.
    """
    rotation, direction = matrix(R), vector(t)
    for panel in range(consistent.size // LANES):
        for lane in range(LANES):
            i = panel * LANES + lane
            residual = sampson(pairs, panel * PANEL + lane, rotation, direction)
            consistent[i] = where(abs(residual) < tolerance, 1.0, consistent[i])


@inner_kernel
def is_same_mode(R: np.ndarray, t: np.ndarray, best: Pose) -> bool:
    """Whether a pose is within the uncertainty of the best pose.

    The criterion is ``1/2 x^T G x < 2`` for the difference x of the two poses and the Gauss-Newton
    matrix G of the best pose. The result is False if the best pose has a share of inliers of at
    most `MIN_SHARE`, or if the directions differ by more than 60 degrees.
    """
    if not _has_inliers(best) or dot(vector(t), vector(best.t)) < 0.5:
        return False
    trace, distance2 = _apart(R, t, best.R, best.t, best.normal)
    return trace > 2.0 and distance2 < 2.0 * SAME_MODE_LOG_RATIO


@inlined_kernel
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, normal: np.ndarray
) -> tuple[float, float]:
    """Trace of the rotation between two poses, and squared Mahalanobis distance of the poses."""
    A, B = matrix(R), matrix(other_R)
    trace = dot(A[0], B[0]) + dot(A[1], B[1]) + dot(A[2], B[2])
    # To first order, the rotation vector is half the difference of the off-diagonal elements.
    first, second = tangent_columns(vector(other_t))
    x = (
        0.5 * (dot(A[2], B[1]) - dot(A[1], B[2])),
        0.5 * (dot(A[0], B[2]) - dot(A[2], B[0])),
        0.5 * (dot(A[1], B[0]) - dot(A[0], B[1])),
        dot(first, vector(t)),
        dot(second, vector(t)),
    )
    distance2 = 0.0
    for k in range(5):
        for j in range(5):
            distance2 = distance2 + x[k] * normal[k, j] * x[j]
    return trace, distance2


@step_kernel
def _is_twisted(matches: PackedMatches, pose: Pose) -> bool:
    """Whether a pose is a twisted pair: most matches have the epipole between their rays.

    The twisted pair of a pose is rotated by half a turn about the baseline and satisfies the same
    epipolar constraints.
    """
    rotation, direction = matrix(pose.R), vector(pose.t)
    twisted = 0
    for i in range(matches.total):
        at = address(i)
        m, b = rotate(rotation, ray0(matches.pairs, at)), ray1(matches.pairs, at)
        twisted += 1 if dot(m, b) < dot(m, direction) * dot(b, direction) else 0
    return 2 * twisted > matches.total


@step_kernel
def refine_if_competitive(
    matches: PackedMatches, pose: Pose, best: Pose, within: float
) -> tuple[bool, bool]:
    """Refine a hypothesis as long as it may come within a margin of the best pose.

    The cost is the negative log likelihood plus the Laplace factor. The limit is the cost of the
    best pose plus the margin ``within``. The refinement ends at convergence or after `COARSE_STEPS`
    steps, and is given up earlier in two cases: the pose has become the same mode as the best pose,
    or the cost minus an upper bound of its remaining decrease is not below the limit. The upper
    bound is ``4 p + l``, where p is the decrease predicted for the next step, and l is the decrease
    in the last step. The factor 4 covers effects outside the quadratic model: matches that become
    inliers, and a smaller noise variance.

    The function returns two values: whether the cost of the refined hypothesis is below the limit
    and the hypothesis is a different mode, and whether the cost of the initial pose of the
    hypothesis was below the limit.
    """
    limit, normal, reached, shares = best.cost[0] + within, pose.normal, pose.cost, np.empty(4)
    point = linearisation_point(matches, pose.R, pose.t, pose.mixture)
    state, kept = np.empty(5), np.empty(KEPT_SIZE)
    begin(matches, point.mixture, state)
    cost, was_close = math.inf, False
    for step in range(COARSE_STEPS):
        before = cost
        goes_on = advance(matches, point, COARSE_TOLERANCE, normal, reached, shares, state, kept)
        cost = reached[0] + laplace_factor(normal)
        if step == 0:
            before, was_close = cost, cost < limit
        gain_bound = REMAINING_GAIN_FACTOR * state[STATE_PREDICTED_DECREASE] + before - cost
        if not cost - gain_bound < limit or is_same_mode(point.R, point.t, best):
            return False, was_close
        if not goes_on:
            break
    finish(point.R, point.t, point.mixture, normal, reached, shares, kept)
    _add_laplace_factor(matches, pose)
    return pose.cost[0] < limit and not is_same_mode(pose.R, pose.t, best), was_close


@inner_kernel
def compare_hypothesis(
    matches: PackedMatches,
    hypothesis: Pose,
    best: Pose,
    secondary: Pose,
    within: float,
) -> tuple[bool, bool]:
    """Refine a hypothesis as long as it may compete, and keep the likelier pose as ``best``.

    The less likely of the two poses is written to ``secondary`` if three conditions hold. The
    directions of the two poses differ by more than 20 degrees. The less likely pose is likelier
    than the old ``secondary``. The log likelihoods of the two poses differ by less than a margin:
    `MODE_MARGIN` if ``best`` is the less likely pose, ``within`` if the hypothesis is. A hypothesis
    that is a twisted pair (`_is_twisted`) is kept neither as ``best`` nor as ``secondary``.

    The function returns the two values of `refine_if_competitive`: whether the refined hypothesis
    is within the margin ``within`` of the best pose and a different mode, and whether the initial
    pose of the hypothesis was within this margin.
    """
    competes, was_close = refine_if_competitive(matches, hypothesis, best, within)
    if not competes:
        return False, was_close
    if _is_twisted(matches, hypothesis):
        return True, was_close
    is_close = best.cost[0] < hypothesis.cost[0] + MODE_MARGIN and _has_other_direction(
        hypothesis, best
    )
    is_better = hypothesis.cost[0] < best.cost[0]
    less_likely = best if is_better else hypothesis
    if is_close and less_likely.cost[0] < secondary.cost[0]:
        copy_pose(less_likely, secondary)
    if is_better:
        copy_pose(hypothesis, best)
    return True, was_close


@step_kernel
def planar_margin(count: int) -> float:
    """Difference of log likelihoods up to which the two motions of a plane compete."""
    return max(MODE_MARGIN, PLANAR_MARGIN * math.sqrt(count / MAX_SEARCHED))


@inner_kernel
def is_secondary_mode(secondary: Pose, best: Pose) -> bool:
    """Whether a pose is within `MODE_MARGIN` of the best pose, and more than 20 degrees away."""
    return secondary.cost[0] < best.cost[0] + MODE_MARGIN and _has_other_direction(secondary, best)


@step_kernel
def _has_other_direction(pose: Pose, best: Pose) -> bool:
    return dot(vector(pose.t), vector(best.t)) < COS_DIFFERENT_MODE
