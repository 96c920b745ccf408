"""Rotation of direction vectors: residuals, consensus and refinement when translation is absent."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, sum_kernel
from farpoint._kernels.exponential import exp_and_eighth, lane_log
from farpoint._kernels.likelihood import POOR, update_mixture
from farpoint._kernels.linear import (
    apply_rotation_step,
    clear,
    copy,
    draw_index,
    kabsch,
    solve_spd,
)
from farpoint._kernels.pairs import (
    LANES,
    PANEL,
    address,
    flow_variance,
    noise0,
    noise1,
    ray0,
    ray1,
)
from farpoint._kernels.vectors import (
    Matrix,
    combine,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    tangent_columns,
)

__all__ = [
    "enlarge_rotation",
    "explain_rotation",
    "refine_rotation",
    "rotation_distance2",
    "rotation_linearize",
    "search_rotation",
]


@inlined_kernel
def _distance2(pairs: np.ndarray, at: int, R: Matrix) -> float:
    """``|b - R a|^2`` in units of the noise of one coordinate (isotropic)."""
    d = combine(1.0, ray1(pairs, at), -1.0, rotate(R, ray0(pairs, at)))
    return dot(d, d) / flow_variance(pairs, at)


@sum_kernel
def _truncated_squares(pairs: np.ndarray, R: np.ndarray, limit: float) -> float:
    """Sum of the squared distances from a rotation, each at most ``limit``."""
    turn = matrix(R)
    cost = 0.0
    for panel in range(pairs.shape[0] // PANEL):
        for lane in range(LANES):
            cost += min(_distance2(pairs, panel * PANEL + lane, turn), limit)
    return cost


@kernel
def search_rotation(
    pairs: np.ndarray,
    count: int,
    tolerance: float,
    max_iterations: int,
    state: np.ndarray,
    R: np.ndarray,
) -> int:
    """Consensus over rotations from three rays each (eqs. 7-13 of the paper); returns iterations.

    Minimises the truncated squares ``sum min(|b - R a|^2 / variance, tolerance^2)`` of the
    ``count`` matches. Stops when with 99.9 % one sample of consistent rays has been drawn. ``R``
    receives the best rotation.
    """
    limit = tolerance * tolerance
    hypothesis, M = np.empty((3, 3)), np.empty((3, 3))
    best = math.inf
    needed = max_iterations
    iteration = 0
    while iteration < needed:
        iteration += 1
        clear(M)
        for _ in range(3):
            at = address(draw_index(state, count))
            a, b = ray0(pairs, at), ray1(pairs, at)
            for j in range(3):
                for k in range(3):
                    M[j, k] += b[j] * a[k]
        if not kabsch(M, hypothesis):
            continue
        cost = _truncated_squares(pairs, hypothesis, limit)
        if cost < best:
            best = cost
            copy(hypothesis, R)
            share = 1.0 - best / (limit * count)
            miss = 1.0 - share * share * share
            if 1e-3 < miss < 1.0:
                needed = min(max_iterations, int(math.log(1e-3) / math.log(miss)) + 1)
            elif miss <= 1e-3:
                break
    return iteration


@sum_kernel
def _correlate(pairs: np.ndarray, R: np.ndarray, limit: float, M: np.ndarray) -> float:
    """``M = sum b a^T / variance`` over the matches within ``limit`` of a rotation; their number.

    Those that fill up the panels agree with any rotation and weigh nothing.
    """
    turn = matrix(R)
    inside = 0.0
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0
    for panel in range(pairs.shape[0] // PANEL):
        for lane in range(LANES):
            at = panel * PANEL + lane
            a, b = ray0(pairs, at), ray1(pairs, at)
            agrees = 1.0 if _distance2(pairs, at, turn) <= limit else 0.0
            inside += agrees
            weight = agrees / flow_variance(pairs, at)
            x, y, z = weight * b[0], weight * b[1], weight * b[2]
            m00, m01, m02 = m00 + x * a[0], m01 + x * a[1], m02 + x * a[2]
            m10, m11, m12 = m10 + y * a[0], m11 + y * a[1], m12 + y * a[2]
            m20, m21, m22 = m20 + z * a[0], m21 + z * a[1], m22 + z * a[2]
    M[0, 0], M[0, 1], M[0, 2] = m00, m01, m02
    M[1, 0], M[1, 1], M[1, 2] = m10, m11, m12
    M[2, 0], M[2, 1], M[2, 2] = m20, m21, m22
    return inside


@kernel
def enlarge_rotation(
    pairs: np.ndarray, count: int, tolerance: float, R: np.ndarray, consistent: np.ndarray
) -> int:
    """Enlarge the consistent set step by step, re-fitting after each; returns its size.

    The set grows from half the tolerance to all of it: a rotation from three noisy rays is off by
    about as much as the far points that it should recognise. ``consistent`` (count,) receives
    whether a match belongs to it; ``R`` is improved in place.
    """
    M = np.empty((3, 3))
    filled_up = pairs.shape[0] // PANEL * LANES - count
    limit = tolerance * tolerance
    size = 0
    for step in range(12):
        previous = size
        within = limit * min(1.0, (0.5 + 0.125 * step) ** 2)
        size = int(_correlate(pairs, R, within, M)) - filled_up
        if step > 4 and size == previous:
            break
        if size < 2 or not kabsch(M, R):
            break
    turn = matrix(R)
    for i in range(count):
        consistent[i] = _distance2(pairs, address(i), turn) <= limit
    return size


@inlined_kernel
def _tangent_residual(
    pairs: np.ndarray, at: int, R: Matrix
) -> tuple[tuple, tuple, float, float, float, float, float]:
    """Basis ``E`` of the plane at ``b``, ``E^T (b - R a)``, its covariance for unit noise."""
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    first, second = tangent_columns(b)
    d = combine(1.0, b, -1.0, m)
    x = combine(
        1.0, noise1(pairs, at, first), 1.0, rotate(R, noise0(pairs, at, rotate_back(R, first)))
    )
    y = combine(
        1.0, noise1(pairs, at, second), 1.0, rotate(R, noise0(pairs, at, rotate_back(R, second)))
    )
    return (
        first,
        second,
        dot(first, d),
        dot(second, d),
        dot(first, x),
        dot(second, x),
        dot(second, y),
    )


@kernel
def rotation_distance2(pairs: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Squared Mahalanobis distances ``out`` of ``b`` from ``R a``, in units of the noise.

    Two degrees of freedom each where translation is absent.
    """
    turn = matrix(R)
    for panel in range(out.shape[0] // LANES):
        for lane in range(LANES):
            _, _, z0, z1, s00, s01, s11 = _tangent_residual(pairs, panel * PANEL + lane, turn)
            square = s11 * z0 * z0 - 2.0 * s01 * z0 * z1 + s00 * z1 * z1
            out[panel * LANES + lane] = square / (s00 * s11 - s01 * s01)


@inlined_kernel
def _densities(square: float, precision: float, poor: float, prior: float) -> tuple[float, float]:
    """Density of a match, if good and if poor, over that of a good one at 0, in two dimensions."""
    whole, eighth = exp_and_eighth(0.5 * square * precision)
    return prior * (1.0 - poor) * whole, prior * poor / (POOR * POOR) * eighth


@sum_kernel
def rotation_linearize(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    H: np.ndarray,
    g: np.ndarray,
    sums: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (3,) and Gauss-Newton matrix ``H`` (3, 3) without translation.

    As `likelihood.linearize` with the residual of two dimensions ``E^T (b - R a)`` on the tangent
    plane of ``b`` and its covariance ``E^T (S_b + R S_a R^T) E``. ``sums`` (3,) receives the
    expected number of right matches, of poor ones, and the squares of good ones.
    """
    turn = matrix(R)
    precision, poor = 1.0 / mixture[0], mixture[2]
    cost = used = right = doubtful = squares = 0.0
    g0 = g1 = g2 = h00 = h10 = h11 = h20 = h21 = h22 = 0.0
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            first, second, z0, z1, s00, s01, s11 = _tangent_residual(pairs, at, turn)
            over_det = 1.0 / (s00 * s11 - s01 * s01)
            y0, y1 = over_det * (s11 * z0 - s01 * z1), over_det * (s00 * z1 - s01 * z0)
            square = z0 * y0 + z1 * y1
            good, fair = _densities(square, precision, poor, share)
            total = good + fair + clutter
            cost -= lane_log(total)
            used += 1.0 if share > 0.0 else 0.0
            right += (good + fair) / total
            doubtful += fair / total
            weight = (good + fair * 0.125) / total
            squares += weight * square
            # d(b - R a) = m x dtheta, so the rows of J = E^T [m]x are e x m.
            m = rotate(turn, ray0(pairs, at))
            j, k = cross(first, m), cross(second, m)
            weight *= precision
            u, v = weight * y0, weight * y1
            g0, g1, g2 = (
                g0 + u * j[0] + v * k[0],
                g1 + u * j[1] + v * k[1],
                g2 + u * j[2] + v * k[2],
            )
            weight *= over_det
            p = combine(weight * s11, j, -weight * s01, k)
            q = combine(weight * s00, k, -weight * s01, j)
            h00, h10 = h00 + p[0] * j[0] + q[0] * k[0], h10 + p[0] * j[1] + q[0] * k[1]
            h11, h20 = h11 + p[1] * j[1] + q[1] * k[1], h20 + p[0] * j[2] + q[0] * k[2]
            h21, h22 = h21 + p[1] * j[2] + q[1] * k[2], h22 + p[2] * j[2] + q[2] * k[2]
    g[0], g[1], g[2] = g0, g1, g2
    H[0, 0], H[1, 1], H[2, 2] = h00, h11, h22
    H[0, 1] = H[1, 0] = h10
    H[0, 2] = H[2, 0] = h20
    H[1, 2] = H[2, 1] = h21
    sums[0], sums[1], sums[2] = right, doubtful, squares
    return cost + (prior.shape[0] - used) * lane_log(clutter)


@kernel
def refine_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
) -> float:
    """Maximum-likelihood rotation without translation; returns its cost.

    ``mixture`` (3,) holds the variance of good matches, the share of wrong ones among all ``count``
    and that of poor ones, in and out (EM); wrong matches fill a disc of radius ``spread`` (in units
    of the noise).
    """
    g, L, step, sums = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    cost = math.inf
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = _clutter(variance, wrong, spread)
        cost = rotation_linearize(pairs, prior, R, mixture, clutter, H, g, sums)
        square = sums[2] / max(2.0 * sums[0] - 3.0, 1.0)
        update_mixture(square, sums[0], sums[1], count, min_variance, mixture)
        if not solve_spd(H, g, 0.0, L, step):
            break
        apply_rotation_step(R, -step[0], -step[1], -step[2], R)
        size = H[0, 0] * step[0] ** 2 + H[1, 1] * step[1] ** 2 + H[2, 2] * step[2] ** 2
        if size < 1e-6 and abs(mixture[0] - variance) < 1e-3 * variance:
            break
    return cost


@inner_kernel
def _clutter(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of good ones at 0, in two dimensions."""
    return wrong / (1.0 - wrong) * 2.0 * variance / (spread * spread)


@kernel
def explain_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    spread: float,
    R: np.ndarray,
    mixture: np.ndarray,
    distance2: np.ndarray,
    right: np.ndarray,
) -> float:
    """Distance of each match as by `rotation_distance2`, and the probability that it is right.

    Returns the share of the information that there is without knowing which matches are good, poor
    or wrong, as `information.information` does.
    """
    rotation_distance2(pairs, R, distance2)
    clutter = _clutter(mixture[0], mixture[1], spread)
    precision = 1.0 / mixture[0]
    known = missing = 0.0
    for i in range(prior.shape[0]):
        good, fair = _densities(distance2[i], precision, mixture[2], prior[i])
        over = 1.0 / (good + fair + clutter)
        right[i] = (good + fair) * over
        weight, weight2 = (good + fair * 0.125) * over, (good + fair * 0.125 * 0.125) * over
        known += weight
        missing += 0.5 * distance2[i] * precision * (weight2 - weight * weight)
    return 1.0 - missing / known if known > 0.0 else 1.0
