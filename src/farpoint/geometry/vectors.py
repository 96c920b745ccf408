"""Arithmetic of small vectors and matrices, and the median, faster than NumPy's functions."""

from __future__ import annotations

import numpy as np

__all__ = ["cross", "median", "products", "solutions"]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (..., 3), along the last axis."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    product[..., 0] = ay * bz - az * by
    product[..., 1] = az * bx - ax * bz
    product[..., 2] = ax * by - ay * bx
    return product


def median(values: np.ndarray) -> float:
    """Median of at least one finite number, (N,)."""
    half = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, half)[half])
    parts = np.partition(values, (half - 1, half))
    return float(0.5 * (parts[half - 1] + parts[half]))


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix products (N, I, K) of (N, I, J) and (N, J, K), for J = 2 or 3."""
    total = a[:, :, 0, None] * b[:, 0, None, :]
    for j in range(1, a.shape[2]):
        total += a[:, :, j, None] * b[:, j, None, :]
    return total


def solutions(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Solutions x (N, 2) of ``M x = v`` for matrices M (N, 2, 2) and vectors v (N, 2)."""
    (a, b), (c, d) = matrices[:, 0].T, matrices[:, 1].T
    x, y = vectors.T
    return np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None]
