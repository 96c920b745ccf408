"""Rotation of direction vectors: residuals, consensus and refinement when translation is absent."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.likelihood import POOR, update_mixture
from farpoint._kernels.linear import (
    apply_rotation_step,
    clear,
    copy,
    draw_index,
    kabsch,
    solve_spd,
    tangent_basis,
)
from farpoint._kernels.pairs import RayPairs
from farpoint._kernels.vectors import column, combine, cross, dot, rotate, row

__all__ = [
    "enlarge_rotation",
    "refine_rotation",
    "rotation_distance2",
    "rotation_linearize",
    "search_rotation",
]


@kernel
def _fit(pairs: RayPairs, weight: np.ndarray, R: np.ndarray) -> bool:
    """Rotation of all matches with positive weight; False where they do not fix one."""
    M = np.empty((3, 3))
    clear(M)
    for i in range(pairs.rays0.shape[0]):
        if weight[i] > 0.0:
            for j in range(3):
                wb = weight[i] * pairs.rays1[i, j]
                for k in range(3):
                    M[j, k] += wb * pairs.rays0[i, k]
    return kabsch(M, R)


@kernel
def _squared_distance(pairs: RayPairs, precision: np.ndarray, R: np.ndarray, i: int) -> float:
    """``|b - R a|^2`` in units of the noise of one coordinate (isotropic)."""
    d = combine(1.0, row(pairs.rays1, i), -1.0, rotate(R, row(pairs.rays0, i)))
    return precision[i] * dot(d, d)


@kernel
def search_rotation(
    pairs: RayPairs,
    precision: np.ndarray,
    tolerance: float,
    max_iterations: int,
    state: np.ndarray,
    R: np.ndarray,
) -> int:
    """Consensus over rotations from three rays each (eqs. 7-13 of the paper); returns iterations.

    Minimises the truncated squares ``sum min(|b - R a|^2 precision / tolerance^2, 1)``. Stops when
    with 99.9 % one sample of consistent rays has been drawn. ``R`` receives the best rotation.
    """
    n = pairs.rays0.shape[0]
    limit = tolerance * tolerance
    hypothesis = np.empty((3, 3))
    M = np.empty((3, 3))
    best = math.inf
    needed = max_iterations
    iteration = 0
    while iteration < needed:
        iteration += 1
        clear(M)
        for _ in range(3):
            i = draw_index(state, n)
            for j in range(3):
                for k in range(3):
                    M[j, k] += pairs.rays1[i, j] * pairs.rays0[i, k]
        if not kabsch(M, hypothesis):
            continue
        cost = 0.0
        for i in range(n):
            cost += min(_squared_distance(pairs, precision, hypothesis, i), limit)
            if cost >= best:
                break
        if cost < best:
            best = cost
            copy(hypothesis, R)
            share = 1.0 - best / (limit * n)
            miss = 1.0 - share * share * share
            if 1e-3 < miss < 1.0:
                needed = min(max_iterations, int(math.log(1e-3) / math.log(miss)) + 1)
            elif miss <= 1e-3:
                break
    return iteration


@kernel
def enlarge_rotation(
    pairs: RayPairs,
    precision: np.ndarray,
    tolerance: float,
    R: np.ndarray,
    consistent: np.ndarray,
) -> int:
    """Enlarge the consistent set step by step, re-fitting after each; returns its size.

    The set grows from half the tolerance to all of it: a rotation from three noisy rays is off by
    about as much as the far points that it should recognise. ``consistent`` (N,) receives 0 or 1
    (times the weight of the match in the fit); ``R`` is improved in place.
    """
    n = pairs.rays0.shape[0]
    count = 0
    for step in range(12):
        limit = tolerance * tolerance * min(1.0, (0.5 + 0.125 * step) ** 2)
        previous = count
        count = 0
        for i in range(n):
            inside = _squared_distance(pairs, precision, R, i) <= limit
            consistent[i] = precision[i] if inside else 0.0
            count += 1 if inside else 0
        if step > 4 and count == previous:
            break
        if count < 2 or not _fit(pairs, consistent, R):
            break
    return count


@inner_kernel
def _tangent_residual(
    pairs: RayPairs, R: np.ndarray, E: np.ndarray, i: int
) -> tuple[float, float, float, float, float]:
    """``E^T (b - R a)`` and its covariance (00, 01, 11) for unit noise; fills ``E``."""
    tangent_basis(pairs.rays1[i], E)
    first, second = (E[0, 0], E[1, 0], E[2, 0]), (E[0, 1], E[1, 1], E[2, 1])
    d = combine(1.0, row(pairs.rays1, i), -1.0, rotate(R, row(pairs.rays0, i)))
    s00 = s01 = s11 = 0.0
    for c in range(2):
        turned, own = rotate(R, column(pairs.noise0, i, c)), column(pairs.noise1, i, c)
        x0, x1, y0, y1 = dot(first, own), dot(second, own), dot(first, turned), dot(second, turned)
        s00 += x0 * x0 + y0 * y0
        s01 += x0 * x1 + y0 * y1
        s11 += x1 * x1 + y1 * y1
    return dot(first, d), dot(second, d), s00, s01, s11


@kernel
def rotation_distance2(pairs: RayPairs, R: np.ndarray, out: np.ndarray) -> None:
    """Squared Mahalanobis distances ``out`` (N,) of ``b`` from ``R a``, in units of the noise.

    Two degrees of freedom each where translation is absent.
    """
    E = np.empty((3, 2))
    for i in range(out.shape[0]):
        z0, z1, s00, s01, s11 = _tangent_residual(pairs, R, E, i)
        out[i] = (s11 * z0 * z0 - 2.0 * s01 * z0 * z1 + s00 * z1 * z1) / (s00 * s11 - s01 * s01)


@kernel
def rotation_linearize(
    pairs: RayPairs,
    prior: np.ndarray,
    R: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    H: np.ndarray,
    g: np.ndarray,
    d2: np.ndarray,
    w: np.ndarray,
    poor: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (3,) and Gauss-Newton matrix ``H`` (3, 3) without translation.

    As `likelihood.linearize` with the residual of two dimensions ``E^T (b - R a)`` on the tangent
    plane of ``b`` and its covariance ``E^T (A_b A_b^T + R A_a A_a^T R^T) E``; ``d2`` (N,) receives
    its squared Mahalanobis norm for unit noise.
    """
    E = np.empty((3, 2))
    J = np.empty((2, 3))
    clear(H)
    clear(g)
    cost = 0.0
    precision = 1.0 / mixture[0]
    for i in range(pairs.rays0.shape[0]):
        z0, z1, s00, s01, s11 = _tangent_residual(pairs, R, E, i)
        det = s00 * s11 - s01 * s01
        d2[i] = (s11 * z0 * z0 - 2.0 * s01 * z0 * z1 + s00 * z1 * z1) / det
        if prior[i] == 0.0:
            w[i] = 0.0
            poor[i] = 0.0
            continue
        square = min(0.5 * d2[i] * precision, 500.0)
        good = prior[i] * (1.0 - mixture[2]) * math.exp(-square)
        fair = prior[i] * mixture[2] / (POOR * POOR) * math.exp(-square / (POOR * POOR))
        total = good + fair + clutter
        cost -= math.log(total)
        w[i] = (good + fair) / total
        poor[i] = fair / total
        # d(b - R a) = m x dtheta, so J = E^T [m]x with rows (e x m).
        m = rotate(R, row(pairs.rays0, i))
        for c in range(2):
            J[c, 0], J[c, 1], J[c, 2] = cross((E[0, c], E[1, c], E[2, c]), m)
        scaled = precision * (good + fair / (POOR * POOR)) / (total * det)
        for k in range(3):
            W0 = scaled * (s11 * J[0, k] - s01 * J[1, k])
            W1 = scaled * (s00 * J[1, k] - s01 * J[0, k])
            g[k] += W0 * z0 + W1 * z1
            for j in range(3):
                H[k, j] += W0 * J[0, j] + W1 * J[1, j]
    return cost


@kernel
def refine_rotation(
    pairs: RayPairs,
    prior: np.ndarray,
    spread: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
    d2: np.ndarray,
    w: np.ndarray,
    poor: np.ndarray,
) -> float:
    """Maximum-likelihood rotation without translation; returns its cost.

    The noise and the share of wrong matches are estimated along (EM).

    ``mixture`` (3,) holds the variance of good matches, the share of wrong ones and that of poor
    ones, in and out; wrong matches fill a disc of radius ``spread`` (in units of the noise).
    """
    g = np.empty(3)
    L = np.empty((3, 3))
    step = np.empty(3)
    n = 0.0
    for i in range(prior.shape[0]):
        n += 1.0 if prior[i] > 0.0 else 0.0
    cost = math.inf
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = wrong / (1.0 - wrong) * 2.0 * variance / (spread * spread)
        cost = rotation_linearize(pairs, prior, R, mixture, clutter, H, g, d2, w, poor)
        total = 0.0
        doubtful = 0.0
        squares = 0.0
        for i in range(w.shape[0]):
            total += w[i]
            doubtful += poor[i]
            squares += (w[i] - poor[i] + poor[i] / (POOR * POOR)) * d2[i]
        square = squares / max(2.0 * total - 3.0, 1.0)
        update_mixture(square, total, doubtful, n, min_variance, mixture)
        if not solve_spd(H, g, 0.0, L, step):
            break
        apply_rotation_step(R, -step[0], -step[1], -step[2], R)
        size = H[0, 0] * step[0] ** 2 + H[1, 1] * step[1] ** 2 + H[2, 2] * step[2] ** 2
        if size < 1e-6 and abs(mixture[0] - variance) < 1e-3 * variance:
            break
    return cost
