"""Split-half ratio: squared difference of the poses from two halves, over its expected value."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.constants import (
    COARSE_STEPS,
    HALF_TOLERANCE,
    LANES,
    MAX_SPLIT_RATIO,
    MIN_SIGNAL_NEARBY,
    PANEL,
)
from farpoint._kernels.covariance import covariance_here
from farpoint._kernels.image_parts import split_parts
from farpoint._kernels.normal_equations import inverse_square, size2
from farpoint._kernels.pairs import take_pairs
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.vectors import Matrix, axpby, dot, matrix, tangent_columns, vector

__all__ = ["pose_difference_ratio"]


@kernel
def pose_difference_ratio(
    matches: PackedMatches,
    pose: Pose,
    inliers: float,
    shrunk_flow: bool,
    splits: int,
    part: np.ndarray,
    state: np.ndarray,
) -> float:
    """Mean ratio of the squared difference of the poses from two halves to its expectation.

    The ratio is the mean of ``d^T (C_1 + C_2)^-1 d / 5``, each at most `MAX_SPLIT_RATIO`, over
    ``splits`` random splits of the matches into two halves. d is the difference between the poses
    from the two halves; each of the two poses is refined from ``pose`` by the matches of one half.
    C_1 and C_2 (5, 5) are the covariances from the two halves at ``pose``, by
    `covariance.covariance_here`. Matches with the same number in ``part`` (N,) are in the same
    half. ``state`` is the state of the random generator. A split is left out if one of the halves
    determines no motion. The result is 1 if all splits are left out.
    """
    total, counted = 0.0, 0
    half = np.empty(matches.total, np.int64)
    one = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    expected, beside = np.empty((5, 5)), np.empty((5, 5))
    for _ in range(splits):
        taken = split_parts(part, state, half)
        some, rest = _rows_of(half, 0, taken), _rows_of(half, 1, matches.total - taken)
        if not _refine_by(matches, some, inliers, shrunk_flow, pose, one, expected):
            continue
        if not _refine_by(matches, rest, inliers, shrunk_flow, pose, other, beside):
            continue
        for i in range(5):
            for j in range(5):
                expected[i, j] += beside[i, j]
        inverse, positive = inverse_square(expected)
        if not positive:
            continue
        square = size2(inverse, _apart(one.R, one.t, other.R, other.t, pose.t))
        total += min(square / 5.0, MAX_SPLIT_RATIO)
        counted += 1
    return total / counted if counted > 0 else 1.0


@inner_kernel
def _rows_of(half: np.ndarray, which: int, count: int) -> np.ndarray:
    """The ``count`` rows of one half."""
    rows = np.empty(count, np.int64)
    k = 0
    for i in range(half.size):
        if half[i] == which:
            rows[k] = i
            k += 1
    return rows


@inner_kernel
def _refine_by(
    matches: PackedMatches,
    rows: np.ndarray,
    inliers: float,
    shrunk_flow: bool,
    start: Pose,
    pose: Pose,
    expected: np.ndarray,
) -> bool:
    """Refine a pose by the matches ``rows`` from a start, with new noise parameters.

    ``expected`` (5, 5) receives the covariance from the matches ``rows`` at the start. The
    covariance uses the number of ``inliers`` among all matches, because the noise variance was
    estimated from all matches. The function returns False if the matches determine no motion.
    """
    panels = (rows.size + LANES - 1) // LANES
    pairs, prior = np.empty(panels * PANEL), np.empty(panels * LANES)
    take_pairs(matches.pairs, rows, pairs)
    for j in range(prior.size):
        prior[j] = matches.prior[rows[j]] if j < rows.size else 0.0
    half_width, long_tail = matches.outlier_half_width, matches.long_tail
    point = LinearisationPoint(pairs, prior, start.R, start.t, start.mixture, half_width, long_tail)
    if not covariance_here(point, inliers, shrunk_flow, MIN_SIGNAL_NEARBY, expected):
        return False
    copy(start.R, pose.R)
    copy(start.t, pose.t)
    copy(start.mixture, pose.mixture)
    least, most, soft_cheirality = (
        matches.min_variance,
        matches.max_variance,
        matches.soft_cheirality,
    )
    some = PackedMatches(
        pairs, prior, prior, rows.size, half_width, long_tail, least, most, soft_cheirality
    )
    refine_pose(some, HALF_TOLERANCE, COARSE_STEPS, pose)
    return True


@inlined_kernel
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, base: np.ndarray
) -> tuple[float, float, float, float, float]:
    """``[dtheta, dbeta]`` between two poses, to first order, in the tangent basis of ``base``."""
    x, y, z = _rotation_between(matrix(R), matrix(other_R))
    first, second = tangent_columns(vector(base))
    shift = axpby(1.0, vector(t), -1.0, vector(other_t))
    return x, y, z, dot(first, shift), dot(second, shift)


@inlined_kernel
def _rotation_between(R: Matrix, other: Matrix) -> tuple[float, float, float]:
    """Rotation vector of ``R other^T``, to first order."""
    return (
        0.5 * (dot(R[2], other[1]) - dot(R[1], other[2])),
        0.5 * (dot(R[0], other[2]) - dot(R[2], other[0])),
        0.5 * (dot(R[1], other[0]) - dot(R[0], other[1])),
    )
