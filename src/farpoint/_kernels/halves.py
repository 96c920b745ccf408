"""How far apart the poses are that two halves of the matches lead to."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import formula, lesser
from farpoint._kernels.linear import draw_index
from farpoint._kernels.pairs import LANES, PANEL, take_pairs
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.scratch import copy, index_room, room, scratch
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
    matches: PackedMatches, pose: Pose, covariance: np.ndarray, deals: int, state: np.ndarray
) -> float:
    """Squared difference of the poses by two halves, over that which a ``covariance`` expects.

    The mean over random ``deals``, by the generator's ``state``, of the difference d of two poses,
    each refined from this one by half of the matches: ``d^T (4 C)^-1 d / 5`` with C (5, 5) that of
    all matches, since independent halves have twice that each. 1 on average where C holds, and
    where it is not positive definite.
    """
    inverse, positive = inverse_square(covariance)
    if not positive:
        return 1.0
    count, middle, total = matches.total, matches.total // 2, 0.0
    rows, first, second = _in_order(count), _in_order(middle), _in_order(count - middle)
    one = Pose(scratch(3, 3), scratch(3), scratch(4), scratch(6, 6), scratch(1))
    other = Pose(scratch(3, 3), scratch(3), scratch(4), scratch(6, 6), scratch(1))
    for _ in range(deals):
        _deal(rows, state, first, second)
        _refine_by(matches, first, pose, one)
        _refine_by(matches, second, pose, other)
        square = size2(inverse, _apart(one.R, one.t, other.R, other.t, pose.t))
        total += lesser(0.05 * square, MOST)
    return total / deals


@inner_kernel
def _in_order(count: int) -> np.ndarray:
    rows = index_room(count)
    for i in range(count):
        rows[i] = i
    return rows


@inner_kernel
def _deal(rows: np.ndarray, state: np.ndarray, first: np.ndarray, second: np.ndarray) -> None:
    """Shuffle the rows, and write them into two halves."""
    for i in range(rows.size):
        j = i + draw_index(state, rows.size - i)
        row = rows[j]
        rows[j] = rows[i]
        rows[i] = row
        if i < first.size:
            first[i] = row
        else:
            second[i - first.size] = row


@inner_kernel
def _refine_by(matches: PackedMatches, rows: np.ndarray, start: Pose, pose: Pose) -> None:
    """The pose that these matches lead to from a start, with the noise that it needs."""
    panels = (rows.size + LANES - 1) // LANES
    pairs, prior = room(panels * PANEL), room(panels * LANES)
    take_pairs(matches.pairs, rows, pairs)
    for j in range(prior.size):
        prior[j] = matches.prior[rows[j]] if j < rows.size else 0.0
    copy(start.R, pose.R)
    copy(start.t, pose.t)
    copy(start.mixture, pose.mixture)
    spread, least, most = matches.spread, matches.min_variance, matches.max_variance
    some = PackedMatches(pairs, prior, rows.size, spread, least, most, matches.gives_way)
    refine_pose(some, FINE, MAX_REFINEMENTS, pose)


@formula
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, base: np.ndarray
) -> tuple[float, float, float, float, float]:
    """``[dtheta, dbeta]`` between two poses, to first order, in the tangent basis of ``base``."""
    x, y, z = _turn(matrix(R), matrix(other_R))
    first, second = tangent_columns(vector(base))
    shift = combine(1.0, vector(t), -1.0, vector(other_t))
    return x, y, z, dot(first, shift), dot(second, shift)


@formula
def _turn(R: Matrix, other: Matrix) -> tuple[float, float, float]:
    """Rotation vector of ``R other^T``, to first order."""
    return (
        0.5 * (dot(R[2], other[1]) - dot(R[1], other[2])),
        0.5 * (dot(R[0], other[2]) - dot(R[2], other[0])),
        0.5 * (dot(R[1], other[0]) - dot(R[0], other[1])),
    )
