"""The likelihood of a pose given matches of which some are wrong, its maximum and its curvature.

A match is right with a normal residual of variance ``variance``, or wrong, with the share
``wrong``, and anywhere in a strip of half-width ``spread`` about the epipolar line (all in units of
the noise).
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.epipolar import sampson_curvature, sampson_jacobian
from farpoint._kernels.linear import apply_rotation_step, solve_spd, tangent_basis
from farpoint._kernels.pairs import RayPairs

__all__ = ["apply_step", "clutter_density", "curvature", "linearize", "refine_pose"]


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
    variance: float,
    clutter: float,
    H: np.ndarray,
    g: np.ndarray,
    r: np.ndarray,
    w: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (5,) and Gauss-Newton matrix ``H`` (5, 5) of all matches.

    A match is an inlier with a normal residual or clutter with a uniform one:

        cost = -sum log(prior exp(-r^2 / 2 variance) + clutter),

    where ``prior`` (N,) scales the inlier's share match by match (0 leaves it out) and ``clutter``
    is the density of wrong matches over that of inliers at r = 0. ``r`` (N,) receives the residuals
    and ``w`` (N,) the posterior probabilities of being an inlier, the weights of this step.
    """
    J = np.empty(5)
    H[:, :] = 0.0
    g[:] = 0.0
    cost = 0.0
    for i in range(pairs.rays0.shape[0]):
        if prior[i] == 0.0:
            r[i] = 0.0
            w[i] = 0.0
            continue
        residual = sampson_jacobian(pairs, R, t, basis, i, J)
        likelihood = prior[i] * math.exp(-0.5 * residual * residual / variance)
        weight = likelihood / (likelihood + clutter)
        cost -= math.log(likelihood + clutter)
        r[i] = residual
        w[i] = weight
        scaled = weight / variance
        for k in range(5):
            sJ = scaled * J[k]
            g[k] += sJ * residual
            for m in range(k + 1):
                H[k, m] += sJ * J[m]
    for k in range(5):
        for m in range(k):
            H[m, k] = H[k, m]
    return cost


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
def curvature(
    pairs: RayPairs,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    variance: float,
    clutter: float,
    hessian: np.ndarray,
    information: np.ndarray,
) -> None:
    """Exact Hessian (5, 5) of the cost, and its Gauss-Newton part, the ``information`` (5, 5).

    The Jacobian holds the noisy flow, so the Gauss-Newton part takes noise for flow: at low
    parallax it pretends to know what it does not. The exact Hessian is free of that share.
    """
    J = np.empty(5)
    K = np.empty((5, 5))
    D = np.empty((6, 5))
    basis = np.empty((3, 2))
    tangent_basis(t, basis)
    hessian[:, :] = 0.0
    information[:, :] = 0.0
    for i in range(pairs.rays0.shape[0]):
        if prior[i] == 0.0:
            continue
        r = sampson_curvature(pairs, R, t, basis, i, D, J, K)
        likelihood = prior[i] * math.exp(-0.5 * r * r / variance)
        weight = likelihood / (likelihood + clutter) / variance
        # The weight falls with the residual: a doubtful match bends the cost the other way.
        doubt = 1.0 - clutter / (likelihood + clutter) * r * r / variance
        for k in range(5):
            for m in range(k + 1):
                square = weight * J[k] * J[m]
                information[k, m] += square
                hessian[k, m] += doubt * square + weight * r * K[k, m]
    for k in range(5):
        for m in range(k):
            information[m, k] = information[k, m]
            hessian[m, k] = hessian[k, m]
