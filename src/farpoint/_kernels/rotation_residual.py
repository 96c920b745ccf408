"""Residual of a rotation without translation: ``b - R a`` in the tangent plane at ``b``."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, sum_kernel
from farpoint._kernels.constants import LANES, PANEL
from farpoint._kernels.pairs import noise0, noise1, ray0, ray1
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    tangent_columns,
)

__all__ = ["count_beyond", "rotation_distance2", "whitened_residual"]

Row = tuple[float, float, float, float]


@inlined_kernel
def _tangent_residual(
    pairs: np.ndarray, at: int, R: Matrix
) -> tuple[tuple, tuple, float, float, float, float, float]:
    """Tangent basis ``E`` (3, 2) at ``b``, and ``E^T (b - R a)`` with its covariance.

    The covariance, for a noise sigma of 1, is returned as its upper triangle.
    """
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    d = axpby(1.0, b, -1.0, m)
    first, second = tangent_columns(b)
    x, y = _noise_along(pairs, at, R, first), _noise_along(pairs, at, R, second)
    return (
        first,
        second,
        dot(first, d),
        dot(second, d),
        dot(first, x),
        dot(second, x),
        dot(second, y),
    )


@inlined_kernel
def _noise_along(pairs: np.ndarray, at: int, R: Matrix, e: Vector) -> Vector:
    """Covariance of ``b - R a``, for a noise sigma of 1, times ``e``."""
    later, earlier = noise1(pairs, at, e), noise0(pairs, at, rotate_back(R, e))
    return axpby(1.0, later, 1.0, rotate(R, earlier))


@inlined_kernel
def _square(pairs: np.ndarray, at: int, R: Matrix) -> float:
    """Squared Mahalanobis distance of ``b`` from ``R a``, for a noise sigma of 1."""
    _, _, z0, z1, s00, s01, s11 = _tangent_residual(pairs, at, R)
    return (s11 * z0 * z0 - 2.0 * s01 * z0 * z1 + s00 * z1 * z1) / (s00 * s11 - s01 * s01)


@inlined_kernel
def whitened_residual(pairs: np.ndarray, at: int, R: Matrix) -> tuple[float, Row, Row]:
    """Squared distance, and the whitened rows of Jacobian and residual."""
    first, second, z0, z1, s00, s01, s11 = _tangent_residual(pairs, at, R)
    m = rotate(R, ray0(pairs, at))
    # d(b - R a) = m x dtheta, so the rows of J = E^T [m]x are e x m.
    j, k = cross(first, m), cross(second, m)
    scale0, slope = 1.0 / math.sqrt(s00), s01 / s00
    scale1 = 1.0 / math.sqrt(s11 - slope * s01)
    u, v = scale0 * z0, scale1 * (z1 - slope * z0)
    rest = axpby(scale1, k, -scale1 * slope, j)
    return (
        u * u + v * v,
        (scale0 * j[0], scale0 * j[1], scale0 * j[2], u),
        (rest[0], rest[1], rest[2], v),
    )


@inner_kernel
def rotation_distance2(pairs: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Squared Mahalanobis distances ``out`` of ``b`` from ``R a``, for a noise sigma of 1.

    If there is no translation, each squared distance divided by the noise variance has a
    chi-squared distribution with two degrees of freedom.
    """
    rotation = matrix(R)
    for panel in range(out.size // LANES):
        for lane in range(LANES):
            out[panel * LANES + lane] = _square(pairs, panel * PANEL + lane, rotation)


@sum_kernel
def count_beyond(pairs: np.ndarray, inlier: np.ndarray, R: np.ndarray, limit: float) -> float:
    """Number of inliers (``inlier`` 1, otherwise 0) with a squared distance beyond ``limit``."""
    rotation = matrix(R)
    beyond = 0.0
    for panel in range(inlier.size // LANES):
        for lane in range(LANES):
            square = _square(pairs, panel * PANEL + lane, rotation)
            beyond += inlier[panel * LANES + lane] if square > limit else 0.0
    return beyond
