"""Effect of errors of lens and shutter on rays and on the motion.

The errors ``z`` (r,) are in units of one sigma. The last is the error of the read-out time of a
rolling shutter. The others are errors of the lens.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.cholesky import factorised, solved
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.constants import (
    ROUNDING,
    TINY,
)
from farpoint._kernels.row_rotation import RowMotion, column, unrolled_ray
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    vector,
)

__all__ = [
    "RaysWithErrors",
    "by_turn",
    "flow_variance",
    "lens_sensitivity",
    "rays_with_errors",
]


class RaysWithErrors(NamedTuple):
    """Unit rays (N, 3), with derivatives by the pixel (N, 3, 2) and by the errors (N, 3, r)."""

    rays: np.ndarray
    by_pixel: np.ndarray
    by_error: np.ndarray


@kernel
def rays_with_errors(
    rays: np.ndarray,
    by_pixel: np.ndarray,
    by_parameters: np.ndarray,
    factor: np.ndarray,
    phases: np.ndarray,
    means: np.ndarray,
    rows: RowMotion,
    out: RaysWithErrors,
) -> None:
    """Rays of an image in the axes of the middle row, and their derivatives.

    The pixel of a ray does not change with the lens. By the implicit function theorem, the
    derivative of the ray by the lens is ``-(d ray / d pixel) (d pixel / d lens)``.

    Parameters
    ----------
    rays, by_pixel : ndarray, shapes (N, 3) and (N, 3, 2)
        Rays in the axes of their rows, and derivatives by the pixel.
    by_parameters : ndarray, shape (N, 2, P)
        Derivatives of the pixels by the parameters of the lens.
    factor : ndarray, shape (P, r - 1)
        Changes of the parameters by the errors of the lens.
    phases, means : ndarray, shape (N,)
        Phase of the row of each ray, and mean phase of the two rows of its match (`unroll_rays`).
    rows : RowMotion
    out : RaysWithErrors
        Receives the result.
    """
    lens = factor.shape[1]
    by_rate, by_turn = vector(rows.rate_by_readout), vector(rows.turn_by_readout)
    for i in range(len(rays)):
        ray, u, v, by_row = unrolled_ray(rays, by_pixel, i, phases[i], means[i], rows)
        for k in range(3):
            out.rays[i, k] = ray[k]
            out.by_pixel[i, k, 0], out.by_pixel[i, k, 1] = u[k], v[k] + by_row[k]
        for j in range(lens):
            by_u = by_v = 0.0
            for p in range(len(factor)):
                by_u += by_parameters[i, 0, p] * factor[p, j]
                by_v += by_parameters[i, 1, p] * factor[p, j]
            for k in range(3):
                out.by_error[i, k, j] = -u[k] * by_u - by_v * v[k]
        moved = cross(axpby(-phases[i], by_rate, -means[i], by_turn), ray)
        for k in range(3):
            out.by_error[i, k, lens] = moved[k]


@kernel
def lens_sensitivity(
    R: np.ndarray,
    t: np.ndarray,
    basis: np.ndarray,
    first: RaysWithErrors,
    second: RaysWithErrors,
    sensitivity: np.ndarray,
) -> None:
    """Derivatives (3 + B, r) of a motion by the r errors ``z``: ``-H^-1 sum(w de/dx de/dz)``.

    The residuals ``e`` are those of the epipolar constraint for a motion with the direction ``t``
    and its ``basis`` (3, B), B = 2, and ``x`` is ``[dtheta, dbeta]``. For B = 0, the motion is a
    rotation, and the residuals are the flow that the rotation does not explain. The derivatives are
    zero along directions of ``x`` that the matches do not determine.
    """
    size, errors = sensitivity.shape
    H, G = np.zeros((size, size)), np.zeros((errors, size))
    row, by_error = np.empty(size), np.empty(errors)
    rotation, direction = matrix(R), vector(t)
    for i in range(len(first.rays)):
        if basis.shape[1]:
            weight = _epipolar_row(rotation, direction, basis, first, second, i, row, by_error)
            _add_products(row, by_error, weight, H, G)
        else:
            weight = 1.0 / flow_variance(first, second, i)
            for k in range(3):
                _flow_row(rotation, first, second, i, k, row, by_error)
                _add_products(row, by_error, weight, H, G)
    L, unit, x = np.empty((size, size)), np.empty(size), np.zeros(size)
    is_regular = factorised(H, ROUNDING, unit, L)
    for j in range(errors):
        if is_regular:
            solved(L, unit, G[j], x)
        for k in range(size):
            sensitivity[k, j] = -x[k]


@inner_kernel
def _epipolar_row(
    R: Matrix,
    t: Vector,
    basis: np.ndarray,
    first: RaysWithErrors,
    second: RaysWithErrors,
    i: int,
    row: np.ndarray,
    by_error: np.ndarray,
) -> float:
    """Derivatives of ``e = b . (t x R a)`` by motion and errors, and the weight ``1 / var(e)``."""
    a, b = rotate(R, vector(first.rays[i])), vector(second.rays[i])
    across_a, across_b = cross(b, t), cross(t, a)
    rotated = rotate_back(R, across_a)
    by_theta, by_t = cross(a, across_a), cross(a, b)
    for k in range(3):
        row[k] = by_theta[k]
    for k in range(2):
        row[3 + k] = dot(by_t, (basis[0, k], basis[1, k], basis[2, k]))
    for j in range(len(by_error)):
        by_error[j] = dot(rotated, column(first.by_error, i, j))
        by_error[j] += dot(across_b, column(second.by_error, i, j))
    variance = TINY
    for k in range(2):
        variance += dot(rotated, column(first.by_pixel, i, k)) ** 2
        variance += dot(across_b, column(second.by_pixel, i, k)) ** 2
    return 1.0 / variance


@inner_kernel
def _flow_row(
    R: Matrix,
    first: RaysWithErrors,
    second: RaysWithErrors,
    i: int,
    k: int,
    row: np.ndarray,
    by_error: np.ndarray,
) -> None:
    """Derivatives of coordinate ``k`` of the flow ``b - R a`` by rotation and errors."""
    columns = by_turn(rotate(R, vector(first.rays[i])))
    for j in range(3):
        row[j] = -columns[k][j]
    for j in range(len(by_error)):
        by_error[j] = second.by_error[i, k, j] - dot(R[k], column(first.by_error, i, j))


@inner_kernel
def _add_products(
    row: np.ndarray, by_error: np.ndarray, weight: float, H: np.ndarray, G: np.ndarray
) -> None:
    """``H += weight row row^T`` and ``G += weight by_error row^T``, if all numbers are finite."""
    total = weight
    for j in range(len(row)):
        total += row[j]
    for j in range(len(by_error)):
        total += by_error[j]
    if not math.isfinite(total):
        return
    for j in range(len(row)):
        scaled = weight * row[j]
        for m in range(j + 1):
            H[j, m] += scaled * row[m]
        for m in range(len(by_error)):
            G[m, j] += scaled * by_error[m]


@inlined_kernel
def flow_variance(first: RaysWithErrors, second: RaysWithErrors, i: int) -> float:
    """Variance of the flow along one direction, for a variance of 1 px^2 per coordinate."""
    total = 0.0
    for k in range(3):
        for m in range(2):
            total += first.by_pixel[i, k, m] ** 2 + second.by_pixel[i, k, m] ** 2
    return max(0.5 * total, TINY)


@inlined_kernel
def by_turn(a: Vector) -> Matrix:
    """Matrix with the columns ``e_k x a``: the derivative of ``Exp(dtheta) a``."""
    return (0.0, a[2], -a[1]), (-a[2], 0.0, a[0]), (a[1], -a[0], 0.0)
