"""Functions of single 3 x 3 matrices in plain Python, because NumPy takes 10 times as long."""

from __future__ import annotations

import math

import numpy as np

from farpoint.pose.constants import MIN_RELATIVE_DETERMINANT

__all__ = ["inverse_three", "size2"]


def inverse_three(A: np.ndarray) -> np.ndarray | None:
    """Inverse of a symmetric matrix (3, 3), by cofactors.

    The result is None if the matrix is not finite, not positive definite, or nearly singular.
    """
    inverse = _inverse(A)
    if inverse is None:
        return None
    a, b, c, d, e, f = inverse
    return np.array((a, b, c, b, d, e, c, e, f)).reshape(3, 3)


def size2(v: tuple[float, float, float], covariance: np.ndarray) -> float:
    """Squared Mahalanobis distance ``v^T C^-1 v`` of three numbers by their covariance (3, 3)."""
    inverse = _inverse(covariance)
    if inverse is None:
        values, vectors = np.linalg.eigh(covariance)
        return float(np.sum((vectors.T @ v) ** 2 / np.maximum(values, 1e-300)))
    x, y, z = v
    a, b, c, d, e, f = inverse
    return a * x * x + d * y * y + f * z * z + 2.0 * (b * x * y + c * x * z + e * y * z)


def _inverse(A: np.ndarray) -> tuple[float, float, float, float, float, float] | None:
    """The upper triangle of the inverse matrix, row by row (see `inverse_three`)."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = A.tolist()
    first = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * first[0] + xy * first[1] + xz * first[2]
    plane = xx * yy - xy * xy
    sure = xx > 0.0 and plane > MIN_RELATIVE_DETERMINANT * xx * yy
    if not (sure and MIN_RELATIVE_DETERMINANT * plane * zz < determinant < math.inf):
        return None
    over = 1.0 / determinant
    a, b, c = first[0] * over, first[1] * over, first[2] * over
    return a, b, c, (xx * zz - xz * xz) * over, (xy * xz - xx * yz) * over, plane * over
