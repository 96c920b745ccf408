"""Search for the pose: directions at a known rotation, and joint hypotheses from five rays."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.likelihood import apply_step, refine_pose
from farpoint._kernels.linear import (
    apply_rotation_step,
    clear,
    copy,
    draw_index,
    draw_unit,
    solve_spd,
    tangent_basis,
)
from farpoint._kernels.pairs import RayPairs
from farpoint._kernels.vectors import combine, cross, dot, norm, rotate, rotate_back, row, vector

__all__ = ["iterations_needed", "score_pose", "search_direction", "search_pose", "solve_five"]

# A residual beyond three sigma supports no hypothesis.
GATE_SIGMA = 3.0
# Share of wrong matches that EM starts from.
START_WRONG = 0.2
# Share of poor matches that EM starts from.
START_POOR = 0.1
# Flow after the far rotation, rad, from which on Newton's method starts too far away to be trusted.
LONG_FLOW = 0.05


@kernel
def score_pose(
    pairs: RayPairs,
    R: np.ndarray,
    t: np.ndarray,
    limit: float,
    best: float,
) -> float:
    """Truncated squares ``sum min(r^2, limit)`` of all matches, at the better sign of ``t``.

    A match that flows away from ``t`` by more than the limit lies behind the camera and costs the
    full ``limit``. Returns early, with a cost of at least ``best``, once both signs have lost.
    ``t`` is flipped in place where the other sign is better.
    """
    n = pairs.rays0.shape[0]
    forward = 0.0
    backward = 0.0
    for i in range(n):
        cost = sampson(pairs, R, t, i) ** 2
        if cost >= limit:
            forward += limit
            backward += limit
        else:
            # Flow along the epipolar great circle towards t, against its noise.
            mt = dot(rotate(R, row(pairs.rays0, i)), vector(t))
            flow = dot(row(pairs.rays1, i), vector(t)) - mt
            variance = 0.0
            for k in range(3):
                for c in range(2):
                    variance += pairs.noise0[i, k, c] ** 2 + pairs.noise1[i, k, c] ** 2
            significant = flow * flow > limit * 0.5 * variance * (1.0 - mt * mt)
            forward += limit if significant and flow < 0.0 else cost
            backward += limit if significant and flow > 0.0 else cost
        if forward >= best and backward >= best:
            return best
    if backward < forward:
        for k in range(3):
            t[k] = -t[k]
        return backward
    return forward


@kernel
def search_direction(
    pairs: RayPairs,
    candidates: np.ndarray,
    tolerance: float,
    iterations: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
) -> float:
    """Best direction among intersections of two great circles, at a given rotation; its cost.

    The two are drawn from ``candidates`` (M,), indices of the matches that may carry translation.
    """
    limit = tolerance * tolerance
    hypothesis = np.empty(3)
    best = limit * pairs.rays0.shape[0]
    t[0], t[1], t[2] = 0.0, 0.0, 1.0
    for _ in range(iterations):
        i = candidates[draw_index(state, candidates.shape[0])]
        j = candidates[draw_index(state, candidates.shape[0])]
        if i == j or not intersect_circles(pairs, R, i, j, hypothesis):
            continue
        cost = score_pose(pairs, R, hypothesis, limit, best)
        if cost < best:
            best = cost
            copy(hypothesis, t)
    return best


@kernel
def _solve_square(A: np.ndarray, x: np.ndarray) -> bool:
    """Solve ``A x = x`` (5x5, both overwritten) by elimination with row pivots."""
    n = x.shape[0]
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
def solve_five(pairs: RayPairs, sample: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Pose that satisfies the epipolar constraint of five matches, by Newton from ``R, t``.

    Iterative five-point solver on the manifold (Lui and Drummond, BMVC 2013,
    DOI 10.5244/C.27.116): ``e = b . (t x m)`` has the rows ``[m x (b x t), B^T (m x b)]``, five
    equations in five unknowns. False where it does not converge.
    """
    A = np.empty((5, 5))
    x = np.empty(5)
    basis = np.empty((3, 2))
    tangent_basis(t, basis)
    for _ in range(8):
        largest = 0.0
        for s in range(5):
            i = sample[s]
            b = row(pairs.rays1, i)
            m = rotate(R, row(pairs.rays0, i))
            by_t = cross(m, b)
            A[s, 0], A[s, 1], A[s, 2] = cross(m, cross(b, vector(t)))
            for k in range(2):
                A[s, 3 + k] = dot(by_t, (basis[0, k], basis[1, k], basis[2, k]))
            e = dot(vector(t), by_t)
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
        apply_step(R, t, basis, x)
        if size < 1e-6:
            return True
    return False


@kernel
def iterations_needed(
    wrong: float, flow: float, confidence: float, min_iterations: int, max_iterations: int
) -> int:
    """Samples of five until one without a wrong match led to the pose, with this confidence.

    A good sample converges to the right pose every second time where the ``flow`` that the rotation
    leaves is short, and ever more rarely where it is long (rad): the start is then far away.
    """
    converging = 0.5 / (1.0 + (flow / LONG_FLOW) ** 2)
    hit = converging * max(1.0 - wrong, 0.0) ** 5
    if hit <= 0.0:
        return max_iterations
    needed = math.log(1.0 - confidence) / math.log(1.0 - hit)
    return int(min(max(needed + 1.0, min_iterations), max_iterations))


@inner_kernel
def _draw_distinct(sample: np.ndarray, n: int, state: np.ndarray) -> None:
    """Fill ``sample`` with distinct indices below ``n``."""
    for s in range(sample.shape[0]):
        fresh = False
        while not fresh:
            sample[s] = draw_index(state, n)
            fresh = True
            for q in range(s):
                if sample[q] == sample[s]:
                    fresh = False


@inner_kernel
def _flow2(pairs: RayPairs, R: np.ndarray, i: int) -> float:
    """Squared length of the flow that the rotation leaves of match ``i``."""
    flow = combine(1.0, row(pairs.rays1, i), -1.0, rotate(R, row(pairs.rays0, i)))
    return dot(flow, flow)


@inner_kernel
def _longest_flow_first(pairs: RayPairs, R: np.ndarray, sample: np.ndarray) -> None:
    """Bring the two matches with the longest flow after the rotation to the front."""
    for s in range(2):
        longest = -1.0
        first = s
        for q in range(s, sample.shape[0]):
            flow = _flow2(pairs, R, sample[q])
            if flow > longest:
                longest = flow
                first = q
        sample[s], sample[first] = sample[first], sample[s]


@inner_kernel
def _typical_flow(pairs: RayPairs, R: np.ndarray, scratch: np.ndarray) -> float:
    """Median angle, rad, that the rotation ``R`` leaves between matched rays."""
    largest = 0.0
    for i in range(scratch.shape[0]):
        square = _flow2(pairs, R, i)
        scratch[i] = square
        largest = max(largest, square)
    # The median by bisection, which is enough here: np.median takes a second to compile.
    low, high = 0.0, largest
    for _ in range(16):
        middle = 0.5 * (low + high)
        below = 0
        for i in range(scratch.shape[0]):
            below += 1 if scratch[i] <= middle else 0
        if 2 * below < scratch.shape[0]:
            low = middle
        else:
            high = middle
    return math.sqrt(high)


@kernel
def planar_twin(
    pairs: RayPairs, R: np.ndarray, t: np.ndarray, twin_R: np.ndarray, twin_t: np.ndarray
) -> bool:
    """The other motion that a plane through the matches would allow; False where there is none.

    The plane ``n . X = 1`` (camera 0, unit of the translation) is fitted to the inverse distances
    ``n . a`` of the matches. With ``tau = R^T t`` the plane induces ``R (I + tau n^T)``, and since
    ``tau n^T - n tau^T = [n x tau]x`` the twin exchanges translation and normal and turns by
    ``n x tau``: exact for small motions (Longuet-Higgins, Proc. R. Soc. B 227, 1986,
    DOI 10.1098/rspb.1986.0032), a start for the refinement otherwise.
    """
    M = np.empty((3, 3))
    v = np.empty(3)
    L = np.empty((3, 3))
    n = np.empty(3)
    clear(M)
    clear(v)
    tau = rotate_back(R, vector(t))
    for i in range(pairs.rays0.shape[0]):
        a = row(pairs.rays0, i)
        back = rotate_back(R, row(pairs.rays1, i))
        # back = l0 a + tau up to length: its cross product gives a x back = (back x tau) / l0.
        across = cross(back, tau)
        square = dot(across, across)
        if not square > 1e-12:
            continue
        inverse_distance = dot(cross(a, back), across) / square
        # Each weighs by its own accuracy; a wrong one is bounded by its own size.
        weight = square / (1.0 + inverse_distance * inverse_distance)
        for k in range(3):
            v[k] += weight * inverse_distance * a[k]
            for j in range(3):
                M[k, j] += weight * a[k] * a[j]
    if not solve_spd(M, v, 1e-9, L, n):
        return False
    plane = vector(n)
    if not norm(plane) > 1e-9:
        return False
    # R Exp(turn) = Exp(R turn) R.
    turn = rotate(R, cross(plane, tau))
    apply_rotation_step(R, turn[0], turn[1], turn[2], twin_R)
    normal = rotate(twin_R, plane)
    for k in range(3):
        twin_t[k] = normal[k] / norm(plane)
    return True


@kernel
def search_pose(
    pairs: RayPairs,
    tolerance: float,
    spread: float,
    min_variance: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
    refinements: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
) -> int:
    """Most likely pose among joint five-ray hypotheses and the start ``R, t``; returns iterations.

    Samples are solved in turn from the best pose so far and from the rotation of the start with a
    direction from two of their own rays, which keeps other minima within reach. A hypothesis that
    agrees with more matches than any before it is refined, and judged by its likelihood with the
    noise that it needs: a wrong minimum looks good only with more noise than there is. ``R``, ``t``
    and ``mixture`` (3,) receive the best.
    """
    n = pairs.rays0.shape[0]
    prior = np.empty(n)
    for i in range(n):
        prior[i] = 1.0
    H = np.empty((5, 5))
    r = np.empty(n)
    w = np.empty(n)
    poor = np.empty(n)
    start = R.copy()
    flow = _typical_flow(pairs, start, r)
    hypothesis_R = np.empty((3, 3))
    hypothesis_t = np.empty(3)
    hypothesis_mixture = np.empty(3)
    sample = np.empty(5, np.int64)
    first_variance = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[0] = first_variance
    mixture[1] = START_WRONG
    mixture[2] = START_POOR
    cost = refine_pose(
        pairs, prior, spread, min_variance, refinements, R, t, mixture, H, r, w, poor
    )
    best = _negative_log_likelihood(cost, mixture, n)
    limit = GATE_SIGMA * GATE_SIGMA * mixture[0]
    best_raw = limit * n
    needed = iterations_needed(mixture[1], flow, confidence, min_iterations, max_iterations)
    iteration = 0
    while iteration < needed:
        iteration += 1
        _draw_distinct(sample, n, state)
        if iteration % 2 == 0:
            if flow > 0.2 * LONG_FLOW:
                apply_rotation_step(
                    start,
                    flow * (2.0 * draw_unit(state) - 1.0),
                    flow * (2.0 * draw_unit(state) - 1.0),
                    flow * (2.0 * draw_unit(state) - 1.0),
                    hypothesis_R,
                )
            else:
                copy(start, hypothesis_R)
            _longest_flow_first(pairs, hypothesis_R, sample)
            if not intersect_circles(pairs, hypothesis_R, sample[0], sample[1], hypothesis_t):
                continue
        else:
            copy(R, hypothesis_R)
            copy(t, hypothesis_t)
        if not solve_five(pairs, sample, hypothesis_R, hypothesis_t):
            continue
        raw = score_pose(pairs, hypothesis_R, hypothesis_t, limit, best_raw)
        if raw >= best_raw:
            continue
        best_raw = raw
        copy(mixture, hypothesis_mixture)
        cost = refine_pose(
            pairs,
            prior,
            spread,
            min_variance,
            refinements,
            hypothesis_R,
            hypothesis_t,
            hypothesis_mixture,
            H,
            r,
            w,
            poor,
        )
        likelihood = _negative_log_likelihood(cost, hypothesis_mixture, n)
        if likelihood < best:
            best = likelihood
            copy(hypothesis_R, R)
            copy(hypothesis_t, t)
            copy(hypothesis_mixture, mixture)
            needed = iterations_needed(mixture[1], flow, confidence, min_iterations, max_iterations)
    if planar_twin(pairs, R, t, hypothesis_R, hypothesis_t):
        copy(mixture, hypothesis_mixture)
        cost = refine_pose(
            pairs,
            prior,
            spread,
            min_variance,
            refinements,
            hypothesis_R,
            hypothesis_t,
            hypothesis_mixture,
            H,
            r,
            w,
            poor,
        )
        likelihood = _negative_log_likelihood(cost, hypothesis_mixture, n)
        if likelihood < best:
            copy(hypothesis_R, R)
            copy(hypothesis_t, t)
            copy(hypothesis_mixture, mixture)
    # The likelihood does not know the sign; the flow does.
    score_pose(pairs, R, t, GATE_SIGMA * GATE_SIGMA * mixture[0], math.inf)
    return iteration


@inner_kernel
def _negative_log_likelihood(cost: float, mixture: np.ndarray, n: int) -> float:
    """What `linearize` leaves out of the cost because it does not move the pose."""
    return cost + n * (0.5 * math.log(mixture[0]) - math.log(1.0 - mixture[1]))
