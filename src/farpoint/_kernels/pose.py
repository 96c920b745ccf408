"""Rotation and direction together: consensus over five rays, and refinement to the likelihood."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.epipolar import linearize, sampson
from farpoint._kernels.linear import apply_rotation_step, draw_index, solve_spd, tangent_basis
from farpoint._kernels.pairs import RayPairs

__all__ = ["exact_hessian", "refine_pose", "score_pose", "search_direction", "search_pose"]


@kernel
def apply_step(R: np.ndarray, t: np.ndarray, basis: np.ndarray, x: np.ndarray) -> None:
    """Move the pose by ``x = [dtheta (3), dbeta (2)]`` in place and renew the tangent basis."""
    apply_rotation_step(R, x[0], x[1], x[2], R)
    norm = 0.0
    for k in range(3):
        t[k] += basis[k, 0] * x[3] + basis[k, 1] * x[4]
        norm += t[k] * t[k]
    norm = math.sqrt(norm)
    for k in range(3):
        t[k] /= norm
    tangent_basis(t, basis)


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
            mt = 0.0
            bt = 0.0
            variance = 0.0
            for k in range(3):
                m = (
                    R[k, 0] * pairs.rays0[i, 0]
                    + R[k, 1] * pairs.rays0[i, 1]
                    + R[k, 2] * pairs.rays0[i, 2]
                )
                mt += m * t[k]
                bt += pairs.rays1[i, k] * t[k]
                for c in range(2):
                    variance += pairs.noise0[i, k, c] ** 2 + pairs.noise1[i, k, c] ** 2
            flow = bt - mt
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
    tolerance: float,
    iterations: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
) -> float:
    """Best direction among intersections of two great circles, at a given rotation; its cost."""
    n = pairs.rays0.shape[0]
    limit = tolerance * tolerance
    hypothesis = np.empty(3)
    best = limit * n
    t[0], t[1], t[2] = 0.0, 0.0, 1.0
    for _ in range(iterations):
        i = draw_index(state, n)
        j = draw_index(state, n)
        if i == j or not intersect_circles(pairs, R, i, j, hypothesis):
            continue
        cost = score_pose(pairs, R, hypothesis, limit, best)
        if cost < best:
            best = cost
            t[:] = hypothesis
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
            b0, b1, b2 = pairs.rays1[i, 0], pairs.rays1[i, 1], pairs.rays1[i, 2]
            a0, a1, a2 = pairs.rays0[i, 0], pairs.rays0[i, 1], pairs.rays0[i, 2]
            m0 = R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2
            m1 = R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2
            m2 = R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2
            q0, q1, q2 = b1 * t[2] - b2 * t[1], b2 * t[0] - b0 * t[2], b0 * t[1] - b1 * t[0]
            d0, d1, d2 = m1 * b2 - m2 * b1, m2 * b0 - m0 * b2, m0 * b1 - m1 * b0
            A[s, 0] = m1 * q2 - m2 * q1
            A[s, 1] = m2 * q0 - m0 * q2
            A[s, 2] = m0 * q1 - m1 * q0
            A[s, 3] = basis[0, 0] * d0 + basis[1, 0] * d1 + basis[2, 0] * d2
            A[s, 4] = basis[0, 1] * d0 + basis[1, 1] * d1 + basis[2, 1] * d2
            e = t[0] * d0 + t[1] * d1 + t[2] * d2
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
def search_pose(
    pairs: RayPairs,
    tolerance: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    R_start: np.ndarray,
) -> int:
    """Consensus over joint five-ray hypotheses, from the pose ``R, t`` on; returns iterations.

    Half of the samples are solved from the best pose so far, half from the rotation ``R_start``
    with a direction from two of their own rays, which keeps other minima within reach. ``R`` and
    ``t`` receive the best pose.
    """
    n = pairs.rays0.shape[0]
    limit = tolerance * tolerance
    hypothesis_R = np.empty((3, 3))
    hypothesis_t = np.empty(3)
    sample = np.empty(5, np.int64)
    best = score_pose(pairs, R, t, limit, math.inf)
    needed = _iterations_needed(best / (limit * n), confidence, min_iterations, max_iterations)
    iteration = 0
    while iteration < needed:
        iteration += 1
        for s in range(5):
            fresh = False
            while not fresh:
                sample[s] = draw_index(state, n)
                fresh = True
                for q in range(s):
                    if sample[q] == sample[s]:
                        fresh = False
        if iteration % 2 == 0:
            hypothesis_R[:, :] = R_start
            if not intersect_circles(pairs, hypothesis_R, sample[0], sample[1], hypothesis_t):
                continue
        else:
            hypothesis_R[:, :] = R
            hypothesis_t[:] = t
        if not solve_five(pairs, sample, hypothesis_R, hypothesis_t):
            continue
        cost = score_pose(pairs, hypothesis_R, hypothesis_t, limit, best)
        if cost < best:
            best = cost
            R[:, :] = hypothesis_R
            t[:] = hypothesis_t
            needed = _iterations_needed(
                best / (limit * n), confidence, min_iterations, max_iterations
            )
    return iteration


@kernel
def _iterations_needed(
    outlier_share: float, confidence: float, min_iterations: int, max_iterations: int
) -> int:
    """Samples of five until one without a wrong match was drawn with this confidence.

    A good sample is taken to converge to the right pose every second time.
    """
    hit = 0.5 * max(1.0 - outlier_share, 0.0) ** 5
    if hit <= 0.0:
        return max_iterations
    needed = math.log(1.0 - confidence) / math.log(1.0 - hit)
    return int(min(max(needed + 1.0, min_iterations), max_iterations))


@kernel
def refine_pose(
    pairs: RayPairs,
    prior: np.ndarray,
    spread: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
    r: np.ndarray,
    w: np.ndarray,
) -> float:
    """Maximum-likelihood pose, with noise and wrong matches by EM; returns its cost.

    Gauss-Newton with the full derivative of the residual. ``mixture`` (2,) holds the noise variance
    and the share of wrong matches, in and out; wrong matches fill a strip of half-width ``spread``
    about the epipolar line (in units of the noise's coordinate).
    """
    g = np.empty(5)
    L = np.empty((5, 5))
    x = np.empty(5)
    basis = np.empty((3, 2))
    tangent_basis(t, basis)
    n = 0.0
    for i in range(prior.shape[0]):
        n += 1.0 if prior[i] > 0.0 else 0.0
    cost = math.inf
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = clutter_density(variance, wrong, spread)
        cost = linearize(pairs, prior, R, t, basis, variance, clutter, H, g, r, w)
        total = 0.0
        squares = 0.0
        for i in range(w.shape[0]):
            total += w[i]
            squares += w[i] * r[i] * r[i]
        mixture[0] = max(squares / max(total - 5.0, 1.0), min_variance)
        mixture[1] = min(max(1.0 - total / n, 0.005), 0.95)
        damping = 0.0
        while not solve_spd(H, g, damping, L, x) and damping < 1.0:
            damping = max(10.0 * damping, 1e-9)
        if not damping < 1.0:
            break
        decrease = 0.0
        for k in range(5):
            decrease += g[k] * x[k]
        size = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3] + x[4] * x[4])
        scale = -1.0 if size < 0.3 else -0.3 / size
        for k in range(5):
            x[k] *= scale
        apply_step(R, t, basis, x)
        if decrease < 1e-4 and abs(mixture[0] - variance) < 1e-2 * variance:
            break
    return cost


@kernel
def clutter_density(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of inliers at r = 0."""
    return wrong / (1.0 - wrong) * math.sqrt(2.0 * math.pi * variance) / (2.0 * spread)


@kernel
def exact_hessian(
    pairs: RayPairs,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    variance: float,
    clutter: float,
    hessian: np.ndarray,
    gradient: np.ndarray,
    information: np.ndarray,
) -> None:
    """Second derivative of the robust cost by central differences of its exact gradient.

    Unlike the Gauss-Newton ``information`` (5, 5), which is returned too, it is free of the share
    that the noise in the Jacobian pretends to know (DESIGN: at low parallax nearly all of it).
    """
    n = pairs.rays0.shape[0]
    scratch_H = np.empty((5, 5))
    r = np.empty(n)
    w = np.empty(n)
    basis = np.empty((3, 2))
    moved_basis = np.empty((3, 2))
    moved_R = np.empty((3, 3))
    moved_t = np.empty(3)
    x = np.empty(5)
    side = np.empty((2, 5))
    tangent_basis(t, basis)
    linearize(
        pairs,
        prior,
        R,
        t,
        basis,
        variance,
        clutter,
        information,
        gradient,
        r,
        w,
    )
    for k in range(5):
        step = 1e-2 / math.sqrt(max(information[k, k], 1e-12))
        step = min(step, 1e-3)
        for s in range(2):
            moved_R[:, :] = R
            moved_t[:] = t
            moved_basis[:, :] = basis
            x[:] = 0.0
            x[k] = step if s == 0 else -step
            apply_step(moved_R, moved_t, moved_basis, x)
            # The basis is carried along rather than renewed: both sides need the same axes.
            linearize(
                pairs,
                prior,
                moved_R,
                moved_t,
                basis,
                variance,
                clutter,
                scratch_H,
                side[s],
                r,
                w,
            )
        for m in range(5):
            hessian[k, m] = (side[0, m] - side[1, m]) / (2.0 * step)
    for k in range(5):
        for m in range(k):
            mean = 0.5 * (hessian[k, m] + hessian[m, k])
            hessian[k, m] = mean
            hessian[m, k] = mean
