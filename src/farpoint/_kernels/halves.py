"""How far apart the poses are that two halves of the matches lead to."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.covariance import SIGNAL, covariance_here
from farpoint._kernels.pairs import LANES, PANEL, take_pairs
from farpoint._kernels.patches import deal
from farpoint._kernels.pose import PackedMatches, Pose, Seen
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.squares import inverse_square, size2
from farpoint._kernels.vectors import Matrix, combine, dot, matrix, tangent_columns, vector

__all__ = ["disagreement"]

# No deal counts as more than so many times what is expected of it.
MOST = 50.0
# A step from a half's pose that promises less, in log likelihood, is far within its noise.
FINE = 1e-2
MAX_REFINEMENTS = np.int64(10)


@kernel
def disagreement(
    matches: PackedMatches,
    pose: Pose,
    right: float,
    predicted: bool,
    deals: int,
    patch: np.ndarray,
    state: np.ndarray,
) -> float:
    """Squared difference of the poses by two halves, over that which their covariances expect.

    The mean over random ``deals``, by the generator's ``state``, of the difference d of two poses,
    each refined from this one by half of the matches: ``d^T (C_1 + C_2)^-1 d / 5`` with what is
    expected of either half (5, 5), as of `covariance.covariance_here`, at this pose, which so many
    matches were found to share. Matches of one ``patch`` (N,) go to the same half. Deals of which a
    half fixes no motion are left out; 1 where all are.
    """
    total, counted = 0.0, 0
    half = np.empty(matches.total, np.int64)
    one = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    expected, beside = np.empty((5, 5)), np.empty((5, 5))
    for _ in range(deals):
        taken = deal(patch, state, half)
        some, rest = _rows_of(half, 0, taken), _rows_of(half, 1, matches.total - taken)
        if not _refine_by(matches, some, right, predicted, pose, one, expected):
            continue
        if not _refine_by(matches, rest, right, predicted, pose, other, beside):
            continue
        for i in range(5):
            for j in range(5):
                expected[i, j] += beside[i, j]
        inverse, positive = inverse_square(expected)
        if not positive:
            continue
        square = size2(inverse, _apart(one.R, one.t, other.R, other.t, pose.t))
        total += min(square / 5.0, MOST)
        counted += 1
    return total / counted if counted > 0 else 1.0


@inner_kernel
def _rows_of(half: np.ndarray, which: int, count: int) -> np.ndarray:
    """The matches of one half, of which there are so many."""
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
    right: float,
    predicted: bool,
    start: Pose,
    pose: Pose,
    expected: np.ndarray,
) -> bool:
    """The pose that these matches lead to from a start, with the noise that it needs.

    And the covariance (5, 5) that is ``expected`` of them, at the start; False where they fix no
    motion. As if as many were ``right`` as of all: few would know their noise less well.
    """
    panels = (rows.size + LANES - 1) // LANES
    pairs, prior = np.empty(panels * PANEL), np.empty(panels * LANES)
    take_pairs(matches.pairs, rows, pairs)
    for j in range(prior.size):
        prior[j] = matches.prior[rows[j]] if j < rows.size else 0.0
    spread, tail = matches.spread, matches.tail
    seen = Seen(pairs, prior, start.R, start.t, start.mixture, spread, tail)
    if not covariance_here(seen, right, predicted, SIGNAL, expected):
        return False
    copy(start.R, pose.R)
    copy(start.t, pose.t)
    copy(start.mixture, pose.mixture)
    least, most, gives_way = matches.min_variance, matches.max_variance, matches.gives_way
    some = PackedMatches(pairs, prior, rows.size, spread, tail, least, most, gives_way)
    refine_pose(some, FINE, MAX_REFINEMENTS, pose)
    return True


@inlined_kernel
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, base: np.ndarray
) -> tuple[float, float, float, float, float]:
    """``[dtheta, dbeta]`` between two poses, to first order, in the tangent basis of ``base``."""
    x, y, z = _turn(matrix(R), matrix(other_R))
    first, second = tangent_columns(vector(base))
    shift = combine(1.0, vector(t), -1.0, vector(other_t))
    return x, y, z, dot(first, shift), dot(second, shift)


@inlined_kernel
def _turn(R: Matrix, other: Matrix) -> tuple[float, float, float]:
    """Rotation vector of ``R other^T``, to first order."""
    return (
        0.5 * (dot(R[2], other[1]) - dot(R[1], other[2])),
        0.5 * (dot(R[0], other[2]) - dot(R[2], other[0])),
        0.5 * (dot(R[1], other[0]) - dot(R[0], other[1])),
    )
