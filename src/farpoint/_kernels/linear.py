"""Small linear algebra of fixed sizes: rotations, symmetric systems, random numbers.

The functions write into buffers of the caller. ``np.linalg`` is not used, because it takes seconds
to compile and calls LAPACK.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel
from farpoint._kernels.constants import MAX_ITERATIONS
from farpoint._kernels.normal_equations import sandwich_five
from farpoint._kernels.vectors import (
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    norm,
    tangent_columns,
    vector,
)

__all__ = [
    "add",
    "add_outer",
    "apply_quaternion",
    "apply_rotation_step",
    "draw_direction",
    "draw_index",
    "draw_unit",
    "eigen_five",
    "kabsch",
    "put",
    "sandwich",
    "tangent_basis",
]


@inner_kernel
def draw_unit(state: np.ndarray) -> float:
    """Uniform random number in [0, 1); advances the splitmix64 ``state`` (1,), uint64."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 1.1102230246251565e-16


@inner_kernel
def draw_index(state: np.ndarray, n: int) -> int:
    """Uniform random integer in [0, n). The bias is negligible for n < 2^32."""
    return int(draw_unit(state) * n)


@step_kernel
def draw_direction(state: np.ndarray, d: np.ndarray) -> None:
    """Write a random unit vector to ``d`` (3,), uniformly distributed on the sphere."""
    z = 2.0 * draw_unit(state) - 1.0
    angle = 2.0 * math.pi * draw_unit(state)
    radius = math.sqrt(1.0 - z * z)
    d[0], d[1], d[2] = radius * math.cos(angle), radius * math.sin(angle), z


@inlined_kernel
def tangent_basis(d: np.ndarray, basis: np.ndarray) -> None:
    """Orthonormal basis (3, 2) perpendicular to the unit vector ``d`` (Duff et al., JCGT 2017)."""
    first, second = tangent_columns(vector(d))
    basis[0, 0], basis[1, 0], basis[2, 0] = first
    basis[0, 1], basis[1, 1], basis[2, 1] = second


@inner_kernel
def apply_rotation_step(R: np.ndarray, x: float, y: float, z: float, out: np.ndarray) -> None:
    """``out = Exp((x, y, z)) @ R``; ``out`` may be ``R`` itself."""
    angle2 = x * x + y * y + z * z
    # Unit quaternion of the step. Below 1e-8 rad^2 the power series is exact to rounding.
    if angle2 < 1e-8:
        qw = 1.0 - angle2 / 8.0
        f = 0.5 - angle2 / 48.0
    else:
        angle = math.sqrt(angle2)
        qw = math.cos(0.5 * angle)
        f = math.sin(0.5 * angle) / angle
    apply_quaternion(qw, f * x, f * y, f * z, R, out)


@inlined_kernel
def apply_quaternion(
    qw: float, qx: float, qy: float, qz: float, R: np.ndarray, out: np.ndarray
) -> None:
    """``out = E @ R`` with the rotation E of a unit quaternion, whose scalar is ``qw``."""
    e00, e01, e02 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)
    e10, e11, e12 = 2 * (qx * qy + qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qw * qx)
    e20, e21, e22 = 2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx * qx + qy * qy)
    for j in range(3):
        r0, r1, r2 = R[0, j], R[1, j], R[2, j]
        out[0, j] = e00 * r0 + e01 * r1 + e02 * r2
        out[1, j] = e10 * r0 + e11 * r1 + e12 * r2
        out[2, j] = e20 * r0 + e21 * r1 + e22 * r2


@inner_kernel
def sandwich(
    whole: np.ndarray, part: np.ndarray, inner: np.ndarray, least: float, out: np.ndarray
) -> bool:
    """``H^-1 V H^-1`` with ``V = inner`` and ``H = whole - part``, all (5, 5) and symmetric.

    If ``x^T H x < least x^T whole x`` for some vector x, the function returns False and ``out`` is
    undefined.
    """
    return sandwich_five(whole, part, inner, least, out)


@inner_kernel
def eigen_five(A: np.ndarray, axes: np.ndarray) -> None:
    """Eigenvectors of a symmetric matrix (5, 5), in rows of ``axes``, by Jacobi's method.

    ``A`` is overwritten, and receives the eigenvalues in the diagonal.
    """
    for i in range(5):
        for j in range(5):
            axes[i, j] = 1.0 if i == j else 0.0
    is_diagonal = False
    sweeps = 0
    while not is_diagonal and sweeps < MAX_ITERATIONS:
        sweeps += 1
        is_diagonal = True
        for p in range(4):
            for q in range(p + 1, 5):
                if abs(A[p, q]) > 1e-15 * math.sqrt(abs(A[p, p] * A[q, q])):
                    is_diagonal = False
                    _make_zero(A, p, q, axes)


@step_kernel
def _make_zero(A: np.ndarray, p: int, q: int, axes: np.ndarray) -> None:
    """Jacobi rotation of the axes ``p`` and ``q`` that makes their off-diagonal element zero."""
    cotangent = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
    tangent = 1.0 / (abs(cotangent) + math.sqrt(cotangent * cotangent + 1.0))
    tangent = tangent if cotangent > 0.0 else -tangent
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for k in range(5):
        a, b = A[k, p], A[k, q]
        A[k, p], A[k, q] = cosine * a - sine * b, sine * a + cosine * b
    for k in range(5):
        a, b = A[p, k], A[q, k]
        A[p, k], A[q, k] = cosine * a - sine * b, sine * a + cosine * b
        a, b = axes[p, k], axes[q, k]
        axes[p, k], axes[q, k] = cosine * a - sine * b, sine * a + cosine * b
    A[p, q] = A[q, p] = 0.0


@inner_kernel
def kabsch(M: np.ndarray, R: np.ndarray) -> bool:
    """Rotation maximising ``trace(R.T @ M)`` for ``M = sum b a^T`` (3, 3).

    By the SVD ``M = U S V^T`` the rotation is ``U diag(1, 1, det U V^T) V^T``. This function needs
    no SVD: the maximum is the largest root of a polynomial, and the rotation follows from this
    root (Markley, "Attitude Determination Using Vector Observations: A Fast Optimal Matrix
    Algorithm", J. Astronaut. Sci. 41, 1993). The function returns False if M has a rank below two.
    """
    square, det, cofactors = _invariants(M)
    # The maximal trace is a root of (trace^2 - square)^2 = 4 (cofactors + 2 det trace). Newton's
    # method starts at an upper bound of the largest root and decreases monotonically to this root.
    # The bound follows from trace <= sqrt(3 square) on the right side, and is exact for det = 0, as
    # for rays of a narrow view.
    bound = cofactors + 2.0 * max(det, 0.0) * math.sqrt(3.0 * square)
    trace = math.sqrt(square + 2.0 * math.sqrt(bound))
    for _ in range(60):
        k = trace * trace - square
        step = (k * k - 8.0 * trace * det - 4.0 * cofactors) / (4.0 * trace * k - 8.0 * det)
        trace -= step
        if not step > 1e-15 * trace:
            break
    k = 0.5 * (trace * trace - square)
    # k trace - det = (s0 + s1) (s1 + s2) (s2 + s0), where s are the singular values, the last with
    # the sign of det M. The product is 0 for a rank below two.
    if not k * trace - det > 1e-9 * square * math.sqrt(square):
        return False
    _write_nearest(M, square, trace, R)
    return True


@step_kernel
def _invariants(M: np.ndarray) -> tuple[float, float, float]:
    """Sum of the squared elements, determinant, and sum of the squared cofactors of a matrix."""
    x, y, z = matrix(M)
    over_x, over_y, over_z = cross(y, z), cross(z, x), cross(x, y)
    square = dot(x, x) + dot(y, y) + dot(z, z)
    return square, dot(x, over_x), dot(over_x, over_x) + dot(over_y, over_y) + dot(over_z, over_z)


@step_kernel
def _write_nearest(M: np.ndarray, square: float, trace: float, R: np.ndarray) -> None:
    """Write the rotation with the largest trace of ``R.T @ M``, which is ``trace``."""
    x, y, z = matrix(M)
    xy, yz, zx = dot(x, y), dot(y, z), dot(z, x)
    k = 0.5 * (trace * trace - square) + square
    first = axpby(k - dot(x, x), x, trace, cross(y, z))
    first = axpby(1.0, first, -1.0, axpby(xy, y, zx, z))
    second = axpby(k - dot(y, y), y, trace, cross(z, x))
    second = axpby(1.0, second, -1.0, axpby(xy, x, yz, z))
    first = axpby(1.0 / norm(first), first, 0.0, first)
    third = cross(first, second)
    third = axpby(1.0 / norm(third), third, 0.0, third)
    second = cross(third, first)
    R[0, 0], R[0, 1], R[0, 2] = first
    R[1, 0], R[1, 1], R[1, 2] = second
    R[2, 0], R[2, 1], R[2, 2] = third


@inlined_kernel
def add_outer(b: Vector, a: Vector, weight: float, M: np.ndarray) -> None:
    """``M += weight b a^T``."""
    x, y, z = a
    for j in range(3):
        scaled = weight * b[j]
        M[j, 0] += scaled * x
        M[j, 1] += scaled * y
        M[j, 2] += scaled * z


@inlined_kernel
def put(s: float, a: Vector, v: np.ndarray) -> None:
    """``v = s a``."""
    v[0], v[1], v[2] = s * a[0], s * a[1], s * a[2]


@inlined_kernel
def add(s: float, a: Vector, v: np.ndarray) -> None:
    """``v += s a``."""
    v[0], v[1], v[2] = v[0] + s * a[0], v[1] + s * a[1], v[2] + s * a[2]
