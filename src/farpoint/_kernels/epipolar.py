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
from farpoint._kernels.linear import clear
from farpoint._kernels.pairs import RayPairs
from farpoint._kernels.vectors import (
    Vector,
    column,
    combine,
    cross,
    dot,
    rotate,
    rotate_back,
    row,
    vector,
)

__all__ = ["parallax", "sampson", "sampson_curvature", "sampson_jacobian"]


@kernel
def sampson(pairs: RayPairs, R: np.ndarray, t: np.ndarray, i: int) -> float:
    """Residual of match ``i``, in units of the noise, at pose ``R`` (3, 3), ``t`` (3,)."""
    b = row(pairs.rays1, i)
    n = cross(vector(t), rotate(R, row(pairs.rays0, i)))
    q = rotate_back(R, cross(b, vector(t)))
    u0, u1 = dot(column(pairs.noise0, i, 0), q), dot(column(pairs.noise0, i, 1), q)
    v0, v1 = dot(column(pairs.noise1, i, 0), n), dot(column(pairs.noise1, i, 1), n)
    g = u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1
    # g is 0 only for a match at the epipole itself, which satisfies any epipolar plane.
    return dot(b, n) / math.sqrt(g) if g > 0.0 else 0.0


@kernel
def sampson_jacobian(
    pairs: RayPairs, R: np.ndarray, t: np.ndarray, basis: np.ndarray, i: int, J: np.ndarray
) -> float:
    """Residual of match ``i`` and its full derivative ``J`` (5,) by ``[dtheta, dbeta]``."""
    b, direction = row(pairs.rays1, i), vector(t)
    m = rotate(R, row(pairs.rays0, i))
    n, q = cross(direction, m), cross(b, direction)
    back = rotate_back(R, q)
    a0, a1 = column(pairs.noise0, i, 0), column(pairs.noise0, i, 1)
    b0, b1 = column(pairs.noise1, i, 0), column(pairs.noise1, i, 1)
    u0, u1, v0, v1 = dot(a0, back), dot(a1, back), dot(b0, n), dot(b1, n)
    g = u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1
    if not g > 0.0:
        clear(J)
        return 0.0
    # e = m . q, and with w = R A_a u and z = A_b v the change of g is dg / 2 = w . dq + z . dn
    # (w turning with R): dr = (de - f dg / 2) / sqrt(g) with f = e / g.
    inv = 1.0 / math.sqrt(g)
    e = dot(b, n)
    f = e / g
    w = rotate(R, combine(u0, a0, u1, a1))
    z = combine(v0, b0, v1, b1)
    by_theta = cross(m, combine(1.0, q, -f, cross(z, direction)))
    by_t = cross(m, combine(1.0, b, -f, z))
    _gradient(
        combine(inv, by_theta, -f * inv, cross(w, q)),
        combine(inv, by_t, -f * inv, cross(w, b)),
        basis,
        J,
    )
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
    b, direction = row(pairs.rays1, i), vector(t)
    m = rotate(R, row(pairs.rays0, i))
    n, q = cross(direction, m), cross(b, direction)
    e = dot(b, n)
    g = 0.0
    w = z = (0.0, 0.0, 0.0)
    for c in range(2):
        A, B = rotate(R, column(pairs.noise0, i, c)), column(pairs.noise1, i, c)
        u, v = dot(A, q), dot(B, n)
        g += u * u + v * v
        w, z = combine(1.0, w, u, A), combine(1.0, z, v, B)
        _gradient(cross(A, q), cross(A, b), basis, D[2 + c])
        _gradient(cross(m, cross(B, direction)), cross(m, B), basis, D[4 + c])
    if not g > 0.0:
        clear(J)
        clear(K)
        return 0.0
    y = cross(z, direction)
    _gradient(cross(m, q), cross(m, b), basis, D[0])
    _gradient(
        combine(1.0, cross(w, q), 1.0, cross(m, y)),
        combine(1.0, cross(w, b), 1.0, cross(m, z)),
        basis,
        D[1],
    )
    # K is the second derivative of e - f g / 2, with f = e / g, over sqrt(g). Those of pose and
    # direction are m'' = (m_i e_j + m_j e_i) / 2 - delta_ij m and t'' = -delta_ij t.
    f = e / g
    inv = 1.0 / math.sqrt(g)
    h = combine(1.0, q, -f, y)
    straight = e - f * (dot(w, q) + dot(z, n))
    for k in range(5):
        J[k] = inv * (D[0, k] - f * D[1, k])
        for j in range(k + 1):
            K[k, j] = (3.0 * f * D[1, k] * D[1, j] - D[0, k] * D[1, j] - D[1, k] * D[0, j]) / g
            for c in range(2, 6):
                K[k, j] -= f * D[c, k] * D[c, j]
        K[k, k] -= straight
    for k in range(3):
        for j in range(k + 1):
            K[k, j] += 0.5 * (m[k] * h[j] + m[j] * h[k] - f * (w[k] * q[j] + w[j] * q[k]))
    for k in range(2):
        step = (basis[0, k], basis[1, k], basis[2, k])
        bB = cross(b, step)
        mixed = combine(1.0, cross(m, combine(1.0, bB, -f, cross(z, step))), -f, cross(w, bB))
        for j in range(3):
            K[3 + k, j] += mixed[j]
    for k in range(5):
        for j in range(k + 1):
            K[k, j] *= inv
            K[j, k] = K[k, j]
    return e * inv


@kernel
def parallax(pairs: RayPairs, R: np.ndarray, t: np.ndarray, i: int, by_theta: np.ndarray) -> float:
    """Shift of match ``i`` towards ``t`` along its epipolar great circle, in units of its noise.

    ``by_theta`` (3,) receives its derivative by the rotation; that by the direction, which only
    turns the circle, is of second order.
    """
    m = rotate(R, row(pairs.rays0, i))
    along = combine(1.0, vector(t), -dot(m, vector(t)), m)
    back = rotate_back(R, along)
    variance = 0.0
    for c in range(2):
        u, v = dot(column(pairs.noise0, i, c), back), dot(column(pairs.noise1, i, c), along)
        variance += u * u + v * v
    if not variance > 0.0:
        clear(by_theta)
        return 0.0
    inv = 1.0 / math.sqrt(variance)
    turn = cross(m, along)
    by_theta[0], by_theta[1], by_theta[2] = -inv * turn[0], -inv * turn[1], -inv * turn[2]
    return inv * dot(combine(1.0, row(pairs.rays1, i), -1.0, m), along)


@inner_kernel
def _gradient(by_theta: Vector, by_t: Vector, basis: np.ndarray, out: np.ndarray) -> None:
    """Derivative (5,) by ``[dtheta, dbeta]`` from those by rotation and direction."""
    out[0], out[1], out[2] = by_theta
    for k in range(2):
        out[3 + k] = basis[0, k] * by_t[0] + basis[1, k] * by_t[1] + basis[2, k] * by_t[2]
