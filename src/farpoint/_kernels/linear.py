"""Small linear algebra on fixed sizes: rotations, symmetric systems, and random numbers.

Every function writes into the caller's buffers and allocates nothing, so that the loops above can
call it a million times. No ``np.linalg``: it would cost seconds of compiling (and a LAPACK call).
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.vectors import combine, cross, dot, matrix, norm

__all__ = [
    "apply_rotation_step",
    "clear",
    "copy",
    "draw_direction",
    "draw_index",
    "draw_unit",
    "kabsch",
    "sandwich",
    "solve_five_spd",
    "solve_spd",
    "tangent_basis",
]


@inner_kernel
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """``target[...] = source`` without numba's checks of shapes, which take seconds to compile."""
    for i in range(source.size):
        target.flat[i] = source.flat[i]


@inner_kernel
def clear(target: np.ndarray) -> None:
    """``target[...] = 0``."""
    for i in range(target.size):
        target.flat[i] = 0.0


@kernel
def draw_unit(state: np.ndarray) -> float:
    """Uniform number in [0, 1) from a splitmix64 ``state`` (1,) uint64, which is advanced."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 1.1102230246251565e-16


@kernel
def draw_index(state: np.ndarray, n: int) -> int:
    """Uniform integer in [0, n); its bias over n < 2^32 is beyond notice."""
    return int(draw_unit(state) * n)


@kernel
def draw_direction(state: np.ndarray, d: np.ndarray) -> None:
    """Unit vector ``d`` (3,), uniform on the sphere."""
    z = 2.0 * draw_unit(state) - 1.0
    angle = 2.0 * math.pi * draw_unit(state)
    radius = math.sqrt(1.0 - z * z)
    d[0], d[1], d[2] = radius * math.cos(angle), radius * math.sin(angle), z


@kernel
def tangent_basis(d: np.ndarray, basis: np.ndarray) -> None:
    """Orthonormal basis (3, 2) perpendicular to the unit vector ``d`` (Duff et al., JCGT 2017)."""
    sign = math.copysign(1.0, d[2])
    a = -1.0 / (sign + d[2])
    b = d[0] * d[1] * a
    basis[0, 0] = 1.0 + sign * d[0] * d[0] * a
    basis[1, 0] = sign * b
    basis[2, 0] = -sign * d[0]
    basis[0, 1] = b
    basis[1, 1] = sign + d[1] * d[1] * a
    basis[2, 1] = -d[1]


@kernel
def apply_rotation_step(R: np.ndarray, x: float, y: float, z: float, out: np.ndarray) -> None:
    """``out = Exp((x, y, z)) @ R``; ``out`` may be ``R`` itself."""
    angle2 = x * x + y * y + z * z
    # Unit quaternion of the step; its series at 0 is exact to rounding below 1e-8 rad^2.
    if angle2 < 1e-8:
        qw = 1.0 - angle2 / 8.0
        f = 0.5 - angle2 / 48.0
    else:
        angle = math.sqrt(angle2)
        qw = math.cos(0.5 * angle)
        f = math.sin(0.5 * angle) / angle
    qx, qy, qz = f * x, f * y, f * z
    e00, e01, e02 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)
    e10, e11, e12 = 2 * (qx * qy + qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qw * qx)
    e20, e21, e22 = 2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx * qx + qy * qy)
    for j in range(3):
        r0, r1, r2 = R[0, j], R[1, j], R[2, j]
        out[0, j] = e00 * r0 + e01 * r1 + e02 * r2
        out[1, j] = e10 * r0 + e11 * r1 + e12 * r2
        out[2, j] = e20 * r0 + e21 * r1 + e22 * r2


@kernel
def solve_spd(H: np.ndarray, g: np.ndarray, damping: float, L: np.ndarray, x: np.ndarray) -> bool:
    """Solve ``(H + damping * diag(H)) x = g`` by Cholesky; False where H is not positive definite.

    ``H`` (n, n) and ``g`` (n,) are left as they are; ``L`` (n, n) is scratch.
    """
    if not cholesky(H, damping, L):
        return False
    substitute(L, g, x)
    return True


@inner_kernel
def solve_five_spd(H: np.ndarray, g: np.ndarray, damping: float, x: np.ndarray) -> bool:
    """As `solve_spd` with n = 5, the unknowns of a pose; a larger ``H`` is looked at so far.

    ``L D L^T``, each element in a register of its own: three times as fast as loops over indices,
    which wait for memory and for one root after another.
    """
    more = 1.0 + damping
    d0 = more * H[0, 0]
    inv0 = 1.0 / d0
    u1, u2, u3, u4 = H[1, 0], H[2, 0], H[3, 0], H[4, 0]
    l10, l20, l30, l40 = u1 * inv0, u2 * inv0, u3 * inv0, u4 * inv0
    d1 = more * H[1, 1] - l10 * u1
    inv1 = 1.0 / d1
    v2, v3, v4 = H[2, 1] - l20 * u1, H[3, 1] - l30 * u1, H[4, 1] - l40 * u1
    l21, l31, l41 = v2 * inv1, v3 * inv1, v4 * inv1
    d2 = more * H[2, 2] - l20 * u2 - l21 * v2
    inv2 = 1.0 / d2
    w3, w4 = H[3, 2] - l30 * u2 - l31 * v2, H[4, 2] - l40 * u2 - l41 * v2
    l32, l42 = w3 * inv2, w4 * inv2
    d3 = more * H[3, 3] - l30 * u3 - l31 * v3 - l32 * w3
    inv3 = 1.0 / d3
    z4 = H[4, 3] - l40 * u3 - l41 * v3 - l42 * w3
    l43 = z4 * inv3
    d4 = more * H[4, 4] - l40 * u4 - l41 * v4 - l42 * w4 - l43 * z4
    for k, d in enumerate((d0, d1, d2, d3, d4)):
        if not (d > 1e-14 * H[k, k] and d < math.inf):
            return False
    y0 = g[0]
    y1 = g[1] - l10 * y0
    y2 = g[2] - l20 * y0 - l21 * y1
    y3 = g[3] - l30 * y0 - l31 * y1 - l32 * y2
    y4 = g[4] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
    x[4] = y4 / d4
    x[3] = y3 * inv3 - l43 * x[4]
    x[2] = y2 * inv2 - l32 * x[3] - l42 * x[4]
    x[1] = y1 * inv1 - l21 * x[2] - l31 * x[3] - l41 * x[4]
    x[0] = y0 * inv0 - l10 * x[1] - l20 * x[2] - l30 * x[3] - l40 * x[4]
    return True


@inner_kernel
def cholesky(H: np.ndarray, damping: float, L: np.ndarray) -> bool:
    """``L L^T = H + damping * diag(H)``; False where that is not positive definite."""
    for i in range(L.shape[0]):
        for j in range(i + 1):
            s = H[i, j]
            if i == j:
                s += damping * H[i, i]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if not s > 1e-14 * H[i, i] or not s < math.inf:
                    return False
                L[i, i] = math.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    return True


@inner_kernel
def substitute(L: np.ndarray, g: np.ndarray, x: np.ndarray) -> None:
    """Solve ``L L^T x = g``."""
    n = g.shape[0]
    for i in range(n):
        s = g[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]


@kernel
def sandwich(
    whole: np.ndarray, part: np.ndarray, inner: np.ndarray, least: float, out: np.ndarray
) -> bool:
    """``H^-1 V H^-1`` with ``V = inner`` and ``H = whole - part``, all (5, 5) and symmetric.

    False, and nothing done, unless H is at least ``least`` times ``whole`` in every direction.
    """
    n = 5
    H, L, x, y = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            H[i, j] = (1.0 - least) * whole[i, j] - part[i, j]
    if not cholesky(H, 0.0, L):
        return False
    for i in range(n):
        for j in range(n):
            H[i, j] = whole[i, j] - part[i, j]
    cholesky(H, 0.0, L)
    for j in range(n):
        substitute(L, inner[j], y[j])  # Row j of V H^-1.
    for j in range(n):
        for i in range(n):
            x[i] = y[i, j]
        substitute(L, x, out[j])
    for i in range(n):
        for j in range(i):
            out[i, j] = out[j, i] = 0.5 * (out[i, j] + out[j, i])
    return True


@kernel
def kabsch(M: np.ndarray, R: np.ndarray) -> bool:
    """Rotation maximising ``trace(R.T @ M)`` for ``M = sum b a^T`` (3, 3).

    The SVD ``M = U S V^T`` gives it as ``U diag(1, 1, det U V^T) V^T``. Without it: the maximum is
    the largest root of a polynomial, and the rotation follows from it (Markley, "Attitude
    Determination Using Vector Observations: A Fast Optimal Matrix Algorithm", J. Astronaut. Sci.
    41, 1993). False where M has rank below two.
    """
    x, y, z = matrix(M)
    over_x, over_y, over_z = cross(y, z), cross(z, x), cross(x, y)  # cofactors
    xx, yy, zz, xy, yz, zx = dot(x, x), dot(y, y), dot(z, z), dot(x, y), dot(y, z), dot(z, x)
    square, det = xx + yy + zz, dot(x, over_x)
    cofactors = dot(over_x, over_x) + dot(over_y, over_y) + dot(over_z, over_z)
    # Newton's method from an upper bound comes down to the largest root and stops there.
    trace = math.sqrt(3.0 * square)
    for _ in range(60):
        k = trace * trace - square
        step = (k * k - 8.0 * trace * det - 4.0 * cofactors) / (4.0 * trace * k - 8.0 * det)
        trace -= step
        if not step > 1e-15 * trace:
            break
    k = 0.5 * (trace * trace - square)
    # (s0 + s1) (s1 + s2) (s2 + s0) of the singular values, the last with the sign of det M.
    if not k * trace - det > 1e-9 * square * math.sqrt(square):
        return False
    first = combine(k + square - xx, x, trace, over_x)
    first = combine(1.0, first, -1.0, combine(xy, y, zx, z))
    second = combine(k + square - yy, y, trace, over_y)
    second = combine(1.0, second, -1.0, combine(xy, x, yz, z))
    first = combine(1.0 / norm(first), first, 0.0, first)
    third = cross(first, second)
    third = combine(1.0 / norm(third), third, 0.0, third)
    second = cross(third, first)
    for i in range(3):
        R[0, i], R[1, i], R[2, i] = first[i], second[i], third[i]
    return True
