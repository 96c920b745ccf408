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

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.pairs import RayPairs

__all__ = ["sampson", "sampson_curvature", "sampson_jacobian"]


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
def sampson_curvature(
    pairs: RayPairs,
    R: np.ndarray,
    t: np.ndarray,
    basis: np.ndarray,
    i: int,
    D: np.ndarray,
    J: np.ndarray,
    K: np.ndarray,
) -> float:
    """Residual of match ``i`` with first and second derivative ``J`` (5,), ``K`` (5, 5).

    By ``[dtheta, dbeta]`` through ``Exp(dtheta) R`` and ``normalize(t + basis dbeta)``. ``D``
    (6, 5) is scratch: the gradients of e, of g / 2 and of the four terms whose squares make g.
    """
    a0, a1, a2 = pairs.rays0[i, 0], pairs.rays0[i, 1], pairs.rays0[i, 2]
    b = pairs.rays1[i]
    m = (
        R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2,
        R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2,
        R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2,
    )
    q = _cross((b[0], b[1], b[2]), (t[0], t[1], t[2]))
    n = _cross((t[0], t[1], t[2]), m)
    bb = (b[0], b[1], b[2])
    tt = (t[0], t[1], t[2])
    e = _dot(bb, n)
    w = (0.0, 0.0, 0.0)
    z = (0.0, 0.0, 0.0)
    g = 0.0
    for c in range(2):
        A0, A1, A2 = pairs.noise0[i, 0, c], pairs.noise0[i, 1, c], pairs.noise0[i, 2, c]
        turned = (
            R[0, 0] * A0 + R[0, 1] * A1 + R[0, 2] * A2,
            R[1, 0] * A0 + R[1, 1] * A1 + R[1, 2] * A2,
            R[2, 0] * A0 + R[2, 1] * A1 + R[2, 2] * A2,
        )
        column = (pairs.noise1[i, 0, c], pairs.noise1[i, 1, c], pairs.noise1[i, 2, c])
        u, v = _dot(turned, q), _dot(column, n)
        g += u * u + v * v
        w = (w[0] + u * turned[0], w[1] + u * turned[1], w[2] + u * turned[2])
        z = (z[0] + v * column[0], z[1] + v * column[1], z[2] + v * column[2])
        _gradient(_cross(turned, q), _cross(turned, bb), basis, D[2 + c])
        _gradient(_cross(m, _cross(column, tt)), _cross(m, column), basis, D[4 + c])
    if not g > 0.0:
        J[:] = 0.0
        K[:, :] = 0.0
        return 0.0
    y = _cross(z, tt)
    _gradient(_cross(m, q), _cross(m, bb), basis, D[0])
    wq, my, wb, mz = _cross(w, q), _cross(m, y), _cross(w, bb), _cross(m, z)
    _gradient(
        (wq[0] + my[0], wq[1] + my[1], wq[2] + my[2]),
        (wb[0] + mz[0], wb[1] + mz[1], wb[2] + mz[2]),
        basis,
        D[1],
    )
    # f = e / g; the second derivatives of e - f g / 2 follow from those of R and t:
    # R'' m = (m e_ij + ...) / 2 - delta_ij m, and t'' = -delta_ij t.
    f = e / g
    inv = 1.0 / math.sqrt(g)
    h = (q[0] - f * y[0], q[1] - f * y[1], q[2] - f * y[2])
    straight = e - f * (_dot(w, q) + _dot(z, n))
    for k in range(5):
        J[k] = inv * (D[0, k] - f * D[1, k])
        for j in range(k + 1):
            second = -f * (
                D[2, k] * D[2, j] + D[3, k] * D[3, j] + D[4, k] * D[4, j] + D[5, k] * D[5, j]
            )
            second += 3.0 * f * D[1, k] * D[1, j] / g
            second -= (D[0, k] * D[1, j] + D[1, k] * D[0, j]) / g
            K[k, j] = second
    for k in range(3):
        for j in range(k + 1):
            K[k, j] += 0.5 * (m[k] * h[j] + m[j] * h[k] - f * (w[k] * q[j] + w[j] * q[k]))
        K[k, k] -= straight
    K[3, 3] -= straight
    K[4, 4] -= straight
    for k in range(2):
        column = (basis[0, k], basis[1, k], basis[2, k])
        bB, zB = _cross(bb, column), _cross(z, column)
        mixed = _cross(m, (bB[0] - f * zB[0], bB[1] - f * zB[1], bB[2] - f * zB[2]))
        turn = _cross(w, bB)
        for j in range(3):
            K[3 + k, j] += mixed[j] - f * turn[j]
    for k in range(5):
        for j in range(k + 1):
            K[k, j] *= inv
            K[j, k] = K[k, j]
    return e * inv


@inner_kernel
def _cross(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner_kernel
def _dot(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner_kernel
def _gradient(
    by_theta: tuple[float, float, float],
    by_t: tuple[float, float, float],
    basis: np.ndarray,
    out: np.ndarray,
) -> None:
    """Derivative (5,) by ``[dtheta, dbeta]`` from those by rotation and direction."""
    for k in range(3):
        out[k] = by_theta[k]
    for k in range(2):
        out[3 + k] = basis[0, k] * by_t[0] + basis[1, k] * by_t[1] + basis[2, k] * by_t[2]
