"""Joint hypotheses: a pose from five matches, how well it fits all, and how many to try."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel, sum_kernel
from farpoint._kernels.epipolar import flow_along, sampson
from farpoint._kernels.likelihood import apply_step
from farpoint._kernels.pairs import LANES, PANEL, address, flow_variance, ray0, ray1
from farpoint._kernels.vectors import cross, dot, matrix, rotate, tangent_columns, vector

__all__ = ["LONG_FLOW", "iterations_needed", "score_pose", "solve_five"]

# Flow after the far rotation, rad, from which on Newton's method starts too far away to be trusted.
LONG_FLOW = 0.05


@sum_kernel
def score_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    limit: float,
    best: float,
) -> float:
    """Truncated squares ``sum min(r^2, limit)`` of all matches, at the better sign of ``t``.

    A match that flows away from ``t`` by more than the limit lies behind the camera, and so does
    one on the other side of ``t``: they cost the full ``limit``. Those of prior 0 cost nothing.
    Returns early, with a cost of at least ``best``, once both signs have lost. ``t`` is flipped in
    place where the other sign is better.
    """
    turn, towards = matrix(R), vector(t)
    forward = backward = 0.0
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at = panel * PANEL + lane
            r = sampson(pairs, at, turn, towards)
            m, b = rotate(turn, ray0(pairs, at)), ray1(pairs, at)
            flow, reach2 = flow_along(m, b, towards)
            cost = min(r * r, limit)
            # On opposite sides of t: the pose is twisted by half a turn about it.
            cost = limit if dot(m, b) < dot(m, towards) * dot(b, towards) else cost
            ahead, noise = flow * abs(flow), limit * flow_variance(pairs, at) * reach2
            weight = 1.0 if prior[panel * LANES + lane] > 0.0 else 0.0
            forward += weight * (limit if ahead < -noise else cost)
            backward += weight * (limit if ahead > noise else cost)
        if min(forward, backward) >= best:
            return best
    if backward < forward:
        for k in range(3):
            t[k] = -t[k]
        return backward
    return forward


@kernel
def _solve_square(A: np.ndarray, x: np.ndarray) -> bool:
    """Solve ``A x = x`` (5x5, both overwritten) by elimination with row pivots."""
    n = 5  # known to the compiler, which then unrolls the loops
    for c in range(n):
        pivot = c
        for i in range(c + 1, n):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        if not abs(A[pivot, c]) > 1e-12:
            return False
        if pivot != c:
            for j in range(c, n):
                A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
            x[c], x[pivot] = x[pivot], x[c]
        for i in range(c + 1, n):
            f = A[i, c] / A[c, c]
            for j in range(c + 1, n):
                A[i, j] -= f * A[c, j]
            x[i] -= f * x[c]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= A[i, j] * x[j]
        x[i] /= A[i, i]
    return True


@kernel
def solve_five(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Pose that satisfies the epipolar constraint of five matches, by Newton from ``R, t``.

    Iterative five-point solver on the manifold (Lui and Drummond, BMVC 2013,
    DOI 10.5244/C.27.116): ``e = b . (t x m)`` has the rows ``[m x (b x t), B^T (m x b)]``, five
    equations in five unknowns. False where it does not converge.
    """
    A = np.empty((5, 5))
    x = np.empty(5)
    for _ in range(8):
        turn, towards = matrix(R), vector(t)
        basis = tangent_columns(towards)
        largest = 0.0
        for s in range(5):
            at = address(sample[s])
            m, b = rotate(turn, ray0(pairs, at)), ray1(pairs, at)
            by_t = cross(m, b)
            A[s, 0], A[s, 1], A[s, 2] = cross(m, cross(b, towards))
            A[s, 3], A[s, 4] = dot(by_t, basis[0]), dot(by_t, basis[1])
            e = dot(towards, by_t)
            # Rows of unit length: a short flow gives a weak row, not a weak equation.
            norm = 0.0
            for k in range(5):
                norm += A[s, k] * A[s, k]
            norm = 1.0 / math.sqrt(norm) if norm > 0.0 else 0.0
            for k in range(5):
                A[s, k] *= norm
            x[s] = -e * norm
            largest = max(largest, abs(x[s]))
        if largest < 1e-7:
            return True
        if not _solve_square(A, x):
            return False
        size = max(
            math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), math.sqrt(x[3] ** 2 + x[4] ** 2)
        )
        if not size < 1e3:
            return False
        if size > 0.5:
            for k in range(5):
                x[k] *= 0.5 / size
        apply_step(R, t, x)
        if size < 3e-4:  # quadratic convergence: the next step would be rounding
            return True
    return False


@kernel
def iterations_needed(
    wrong: float,
    flow: float,
    doubt: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
) -> int:
    """Samples of five until one without a wrong match led to the pose, with this confidence.

    ``doubt`` is the probability that the pose found without them is not the right one. A good
    sample converges to the right pose every second time from a good start, every fourth from a
    doubtful one, and ever more rarely where the ``flow`` that the rotation leaves is long (rad):
    the start is then far away.
    """
    converging = 0.5 / (1.0 + doubt) / (1.0 + (flow / LONG_FLOW) ** 2)
    hit = converging * max(1.0 - wrong, 0.0) ** 5
    if hit <= 0.0:
        return max_iterations
    needed = math.log(min((1.0 - confidence) / doubt, 1.0)) / math.log(1.0 - hit)
    return int(min(max(needed + 1.0, min_iterations), max_iterations))
