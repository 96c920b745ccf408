"""The likelihood of a pose given matches of which some are wrong, its maximum and its curvature.

A match is good, with a normal residual of variance ``variance``; or poor, with `POOR` times its
sigma; or wrong, and anywhere in a strip of half-width ``spread`` about the epipolar line (all in
units of the noise). The shares of poor matches among the right ones and of wrong ones among all are
estimated along, so that normal noise is treated as such and heavy tails lose only what they must.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.epipolar import parallax, sampson_curvature, sampson_jacobian
from farpoint._kernels.linear import apply_rotation_step, clear, copy, solve_spd, tangent_basis
from farpoint._kernels.pairs import RayPairs, flow_variance
from farpoint._kernels.vectors import cross, dot, rotate, row, vector

# Sigma of a poor match over that of a good one.
POOR = 3.0
# A match nearer to the epipole than this, in sigma of its flow, tells nothing of where it is.
EPIPOLE_SIGMA = 8.0

__all__ = ["POOR", "apply_step", "clutter_density", "curvature", "linearize", "refine_pose"]


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
def clutter_density(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of inliers at r = 0."""
    return wrong / (1.0 - wrong) * math.sqrt(2.0 * math.pi * variance) / (2.0 * spread)


@kernel
def linearize(
    pairs: RayPairs,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    basis: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    far_sigma: float,
    H: np.ndarray,
    g: np.ndarray,
    r: np.ndarray,
    w: np.ndarray,
    poor: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (5,) and Gauss-Newton matrix ``H`` (5, 5) of all matches.

    The cost is ``-sum log(prior (good + poor) + clutter)``, where ``prior`` (N,) scales the share
    of right matches one by one (0 leaves a match out) and ``clutter`` is the density of wrong
    matches over that of right ones. ``r`` (N,) receives the residuals, ``w`` (N,) the probabilities
    of being right and ``poor`` (N,) those of being right but poor.

    A right match flows towards ``t``: its density falls off where the flow retreats from ``t`` by
    more than ``far_sigma``, which noise can make a far point do. Up to there it is flat, for
    rotation can imitate parallax, and any slope would pull at the rotation.
    """
    J = np.empty(5)
    turn = np.empty(3)
    clear(H)
    clear(g)
    cost = 0.0
    precision = 1.0 / mixture[0]
    share = mixture[2]
    for i in range(pairs.rays0.shape[0]):
        residual = sampson_jacobian(pairs, R, t, basis, i, J)
        r[i] = residual
        if prior[i] == 0.0:
            w[i] = 0.0
            poor[i] = 0.0
            continue
        square = 0.5 * residual * residual * precision
        retreat = _retreat(pairs, R, t, i, precision, far_sigma, turn)
        ahead = prior[i] * math.exp(-0.5 * retreat * retreat)
        good = ahead * (1.0 - share) * math.exp(-square)
        fair = ahead * share / POOR * math.exp(-square / (POOR * POOR))
        total = good + fair + clutter
        cost -= math.log(total)
        w[i] = (good + fair) / total
        poor[i] = fair / total
        scaled = precision * (good + fair / (POOR * POOR)) / total
        for k in range(5):
            sJ = scaled * J[k]
            g[k] += sJ * residual
            for m in range(k + 1):
                H[k, m] += sJ * J[m]
        if retreat > 0.0:
            for k in range(3):
                g[k] += w[i] * retreat * turn[k]
                for m in range(k + 1):
                    H[k, m] += w[i] * turn[k] * turn[m]
    for k in range(5):
        for m in range(k):
            H[m, k] = H[k, m]
    return cost


@inner_kernel
def _retreat(
    pairs: RayPairs,
    R: np.ndarray,
    t: np.ndarray,
    i: int,
    precision: float,
    far_sigma: float,
    turn: np.ndarray,
) -> float:
    """By how many sigma match ``i`` flows away from ``t``, beyond the noise of a far point.

    ``turn`` (3,) receives the derivative by the rotation where this is positive.
    """
    towards = dot(row(pairs.rays1, i), vector(t)) - dot(rotate(R, row(pairs.rays0, i)), vector(t))
    if towards >= 0.0 or far_sigma == math.inf:
        return 0.0
    scale = math.sqrt(precision)
    retreat = -scale * parallax(pairs, R, t, i, turn) - far_sigma
    if retreat <= 0.0:
        return 0.0
    for k in range(3):
        turn[k] *= -scale
    return retreat


@inner_kernel
def update_mixture(
    square: float, total: float, poor: float, count: float, minimum: float, mixture: np.ndarray
) -> None:
    """EM step of variance, share of wrong and share of poor matches, from weighted sums."""
    mixture[0] = max(square, minimum)
    mixture[1] = min(max(1.0 - total / count, 0.005), 0.95)
    # One poor match in a hundred is taken for granted, to keep the step from locking at none.
    mixture[2] = min((poor + 0.01) / (total + 1.0), 0.5)


@kernel
def refine_pose(
    pairs: RayPairs,
    prior: np.ndarray,
    spread: float,
    min_variance: float,
    far_sigma: float,
    precision: float,
    max_iterations: int,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
    r: np.ndarray,
    w: np.ndarray,
    poor: np.ndarray,
) -> float:
    """Maximum-likelihood pose, with its noise by EM; returns the negative log likelihood.

    Gauss-Newton with the full derivative of the residual. ``mixture`` (3,) holds the variance of
    good matches, the share of wrong ones and that of poor ones, in and out. Steps end when they
    promise less than ``precision``, in the unit of the log likelihood.
    """
    g = np.empty(5)
    L = np.empty((5, 5))
    x = np.empty(5)
    basis = np.empty((3, 2))
    kept_R, kept_t = np.empty((3, 3)), np.empty(3)
    kept_H, kept_g = np.empty((5, 5)), np.empty(5)
    tangent_basis(t, basis)
    n = 0.0
    for i in range(prior.shape[0]):
        n += 1.0 if prior[i] > 0.0 else 0.0
    lowest = math.inf
    damping = 0.0
    converged = False
    for _ in range(max_iterations):
        variance = mixture[0]
        clutter = clutter_density(variance, mixture[1], spread)
        cost = linearize(pairs, prior, R, t, basis, mixture, clutter, far_sigma, H, g, r, w, poor)
        likelihood = cost + left_out(mixture, n)
        # EM with unbiased variance may climb a little; a step that climbs more has gone astray.
        if likelihood > lowest + 0.5:
            copy(kept_R, R)
            copy(kept_t, t)
            copy(kept_H, H)
            copy(kept_g, g)
            tangent_basis(t, basis)
            damping = max(100.0 * damping, 1e-2)
        else:
            if converged:
                break
            lowest = likelihood
            copy(R, kept_R)
            copy(t, kept_t)
            copy(H, kept_H)
            copy(g, kept_g)
            damping *= 0.1
            total = 0.0
            doubtful = 0.0
            squares = 0.0
            for i in range(w.shape[0]):
                total += w[i]
                doubtful += poor[i]
                squares += (w[i] - poor[i] + poor[i] / (POOR * POOR)) * r[i] * r[i]
            square = squares / max(total - 5.0, 1.0)
            update_mixture(square, total, doubtful, n, min_variance, mixture)
        while not solve_spd(H, g, damping, L, x) and damping < 1e6:
            damping = max(10.0 * damping, 1e-9)
        if not damping < 1e6:
            break
        decrease = dot5(g, x)
        size = math.sqrt(dot5(x, x))
        scale = -1.0 if size < 0.3 else -0.3 / size
        for k in range(5):
            x[k] *= scale
        apply_step(R, t, basis, x)
        settled = abs(mixture[0] - variance) < max(0.01, precision) * variance
        converged = decrease < precision and settled
    # The last step was not judged: the pose before it was.
    copy(kept_R, R)
    copy(kept_t, t)
    return lowest


@inner_kernel
def left_out(mixture: np.ndarray, n: float) -> float:
    """What `linearize` leaves out of the negative log likelihood as it does not move the pose."""
    return n * (0.5 * math.log(mixture[0]) - math.log(1.0 - mixture[1]))


@inner_kernel
def dot5(a: np.ndarray, b: np.ndarray) -> float:
    """``a . b`` of arrays (5,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


@inner_kernel
def _is_at_epipole(pairs: RayPairs, R: np.ndarray, t: np.ndarray, i: int, variance: float) -> bool:
    """Whether match ``i`` lies within a few sigma of the epipole, or straight behind."""
    across = cross(vector(t), rotate(R, row(pairs.rays0, i)))
    return dot(across, across) < EPIPOLE_SIGMA**2 * variance * flow_variance(pairs, i)


@kernel
def curvature(
    pairs: RayPairs,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    far_sigma: float,
    hessian: np.ndarray,
    information: np.ndarray,
) -> None:
    """Exact Hessian (5, 5) of the cost, and its Gauss-Newton part, the ``information`` (5, 5).

    The Jacobian holds the noisy flow, so the Gauss-Newton part takes noise for flow: at low
    parallax it pretends to know what it does not. The exact Hessian is free of that share. That
    right matches flow forward tells which are right; as a bound on the pose, which is not Gaussian,
    it is left out. So are matches at the epipole: noise alone decides on their epipolar line.
    """
    precision = 1.0 / mixture[0]
    J = np.empty(5)
    turn = np.empty(3)
    K = np.empty((5, 5))
    D = np.empty((6, 5))
    basis = np.empty((3, 2))
    tangent_basis(t, basis)
    clear(hessian)
    clear(information)
    for i in range(pairs.rays0.shape[0]):
        if prior[i] == 0.0 or _is_at_epipole(pairs, R, t, i, mixture[0]):
            continue
        r = sampson_curvature(pairs, R, t, basis, i, D, J, K)
        square = 0.5 * r * r * precision
        retreat = _retreat(pairs, R, t, i, precision, far_sigma, turn)
        ahead = prior[i] * math.exp(-0.5 * retreat * retreat)
        good = ahead * (1.0 - mixture[2]) * math.exp(-square)
        fair = ahead * mixture[2] / POOR * math.exp(-square / (POOR * POOR))
        total = good + fair + clutter
        weight = precision * (good + fair / (POOR * POOR)) / total
        # The weight changes with the residual: a doubtful match bends the cost the other way.
        fourth = precision * precision * (good + fair / POOR**4) / total
        bend = weight - (fourth - weight * weight) * r * r
        for k in range(5):
            for m in range(k + 1):
                information[k, m] += weight * J[k] * J[m]
                hessian[k, m] += bend * J[k] * J[m] + weight * r * K[k, m]
    for k in range(5):
        for m in range(k):
            information[m, k] = information[k, m]
            hessian[m, k] = hessian[k, m]
