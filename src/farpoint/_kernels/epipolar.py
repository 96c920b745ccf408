"""The Sampson residual of a match and its full derivative.

For unit rays ``a`` (camera 0) and ``b`` (camera 1), ``m = R a`` and unit ``t``, the epipolar
constraint is ``e = b . (t x m) = 0``. A ray is known up to noise ``A n``, where
``n ~ N(0, sigma^2 I)`` and ``A`` (3, 2) is its noise factor; so to first order ``e`` has the
variance ``sigma^2 g`` with

    g = |(R A_a)^T (b x t)|^2 + |A_b^T (t x m)|^2,        r = e / sqrt(g),

and ``r`` is distributed as one coordinate of the noise. ``g`` depends on the pose too: leaving its
derivative out costs a factor of 2.5 in the direction at small baselines.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.pairs import RayPairs

__all__ = ["linearize", "sampson", "sampson_jacobian"]


@kernel
def sampson(pairs: RayPairs, R: np.ndarray, t: np.ndarray, i: int) -> float:
    """Residual of match ``i``, in units of the noise, at pose ``R`` (3, 3), ``t`` (3,)."""
    a0, a1, a2 = pairs.rays0[i, 0], pairs.rays0[i, 1], pairs.rays0[i, 2]
    b0, b1, b2 = pairs.rays1[i, 0], pairs.rays1[i, 1], pairs.rays1[i, 2]
    m0 = R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2
    m1 = R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2
    m2 = R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2
    # n = t x m, q = b x t, and q in camera 0.
    n0, n1, n2 = t[1] * m2 - t[2] * m1, t[2] * m0 - t[0] * m2, t[0] * m1 - t[1] * m0
    q0, q1, q2 = b1 * t[2] - b2 * t[1], b2 * t[0] - b0 * t[2], b0 * t[1] - b1 * t[0]
    p0 = R[0, 0] * q0 + R[1, 0] * q1 + R[2, 0] * q2
    p1 = R[0, 1] * q0 + R[1, 1] * q1 + R[2, 1] * q2
    p2 = R[0, 2] * q0 + R[1, 2] * q1 + R[2, 2] * q2
    u0 = pairs.noise0[i, 0, 0] * p0 + pairs.noise0[i, 1, 0] * p1 + pairs.noise0[i, 2, 0] * p2
    u1 = pairs.noise0[i, 0, 1] * p0 + pairs.noise0[i, 1, 1] * p1 + pairs.noise0[i, 2, 1] * p2
    v0 = pairs.noise1[i, 0, 0] * n0 + pairs.noise1[i, 1, 0] * n1 + pairs.noise1[i, 2, 0] * n2
    v1 = pairs.noise1[i, 0, 1] * n0 + pairs.noise1[i, 1, 1] * n1 + pairs.noise1[i, 2, 1] * n2
    g = u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1
    # g is 0 only for a match at the epipole itself, which satisfies any epipolar plane.
    return (b0 * n0 + b1 * n1 + b2 * n2) / math.sqrt(g) if g > 0.0 else 0.0


@kernel
def sampson_jacobian(
    pairs: RayPairs,
    R: np.ndarray,
    t: np.ndarray,
    basis: np.ndarray,
    i: int,
    J: np.ndarray,
) -> float:
    """Residual of match ``i`` and its full derivative ``J`` (5,) by ``[dtheta, dbeta]``."""
    a0, a1, a2 = pairs.rays0[i, 0], pairs.rays0[i, 1], pairs.rays0[i, 2]
    b0, b1, b2 = pairs.rays1[i, 0], pairs.rays1[i, 1], pairs.rays1[i, 2]
    t0, t1, t2 = t[0], t[1], t[2]
    m0 = R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2
    m1 = R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2
    m2 = R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2
    n0, n1, n2 = t1 * m2 - t2 * m1, t2 * m0 - t0 * m2, t0 * m1 - t1 * m0
    q0, q1, q2 = b1 * t2 - b2 * t1, b2 * t0 - b0 * t2, b0 * t1 - b1 * t0
    p0 = R[0, 0] * q0 + R[1, 0] * q1 + R[2, 0] * q2
    p1 = R[0, 1] * q0 + R[1, 1] * q1 + R[2, 1] * q2
    p2 = R[0, 2] * q0 + R[1, 2] * q1 + R[2, 2] * q2
    u0 = pairs.noise0[i, 0, 0] * p0 + pairs.noise0[i, 1, 0] * p1 + pairs.noise0[i, 2, 0] * p2
    u1 = pairs.noise0[i, 0, 1] * p0 + pairs.noise0[i, 1, 1] * p1 + pairs.noise0[i, 2, 1] * p2
    v0 = pairs.noise1[i, 0, 0] * n0 + pairs.noise1[i, 1, 0] * n1 + pairs.noise1[i, 2, 0] * n2
    v1 = pairs.noise1[i, 0, 1] * n0 + pairs.noise1[i, 1, 1] * n1 + pairs.noise1[i, 2, 1] * n2
    g = u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1
    if not g > 0.0:
        for k in range(5):
            J[k] = 0.0
        return 0.0
    inv = 1.0 / math.sqrt(g)
    e = b0 * n0 + b1 * n1 + b2 * n2
    f = e / g  # dr = (de - f * dg / 2) / sqrt(g)
    # w = R A_a u (camera 1) and z = A_b v: dg/2 = w . d(q) (with A turning) + z . d(n).
    c0 = pairs.noise0[i, 0, 0] * u0 + pairs.noise0[i, 0, 1] * u1
    c1 = pairs.noise0[i, 1, 0] * u0 + pairs.noise0[i, 1, 1] * u1
    c2 = pairs.noise0[i, 2, 0] * u0 + pairs.noise0[i, 2, 1] * u1
    w0 = R[0, 0] * c0 + R[0, 1] * c1 + R[0, 2] * c2
    w1 = R[1, 0] * c0 + R[1, 1] * c1 + R[1, 2] * c2
    w2 = R[2, 0] * c0 + R[2, 1] * c1 + R[2, 2] * c2
    z0 = pairs.noise1[i, 0, 0] * v0 + pairs.noise1[i, 0, 1] * v1
    z1 = pairs.noise1[i, 1, 0] * v0 + pairs.noise1[i, 1, 1] * v1
    z2 = pairs.noise1[i, 2, 0] * v0 + pairs.noise1[i, 2, 1] * v1
    # de/dtheta = m x q; dg/2 = w x q + m x (z x t).
    y0, y1, y2 = z1 * t2 - z2 * t1, z2 * t0 - z0 * t2, z0 * t1 - z1 * t0
    h0, h1, h2 = q0 - f * y0, q1 - f * y1, q2 - f * y2
    J[0] = inv * (m1 * h2 - m2 * h1 - f * (w1 * q2 - w2 * q1))
    J[1] = inv * (m2 * h0 - m0 * h2 - f * (w2 * q0 - w0 * q2))
    J[2] = inv * (m0 * h1 - m1 * h0 - f * (w0 * q1 - w1 * q0))
    # de/dt = m x b; dg/2 = w x b + m x z.
    x0, x1, x2 = b0 - f * z0, b1 - f * z1, b2 - f * z2
    d0 = m1 * x2 - m2 * x1 - f * (w1 * b2 - w2 * b1)
    d1 = m2 * x0 - m0 * x2 - f * (w2 * b0 - w0 * b2)
    d2 = m0 * x1 - m1 * x0 - f * (w0 * b1 - w1 * b0)
    J[3] = inv * (basis[0, 0] * d0 + basis[1, 0] * d1 + basis[2, 0] * d2)
    J[4] = inv * (basis[0, 1] * d0 + basis[1, 1] * d1 + basis[2, 1] * d2)
    return e * inv


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
