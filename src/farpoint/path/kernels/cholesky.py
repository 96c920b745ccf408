"""Positive definite matrices of 10 to 100 rows: Cholesky factor, solution, inverse, elimination.

BLAS is not used, because for matrices of this size the threads of BLAS wait for each other longer
than a product takes. The functions write their results into arrays that the caller passes.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.cholesky import factorised, solved
from farpoint._kernels.compile import loop_kernel

__all__ = ["eliminate_points", "factorise", "invert", "point_variances", "solve"]


@loop_kernel
def factorise(H, damping, unit, L):
    """`factorised`, called by Python."""
    return factorised(H, damping, unit, L)


@loop_kernel
def solve(L, unit, g, x):
    """`solved`, called by Python."""
    solved(L, unit, g, x)


@loop_kernel
def invert(L, unit, columns, out):
    """Inverse of H (D, D) from the factor ``L, unit`` of H; ``columns`` (D, D) is a buffer."""
    n = len(L)
    # Row j of the buffer receives column j of the inverse factor.
    for j in range(n):
        columns[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * columns[j, k]
            columns[j, i] = -total / L[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += columns[i, k] * columns[j, k]
            out[i, j] = out[j, i] = total * unit[i] * unit[j]


@loop_kernel
def eliminate_points(coupling, point_h, point_g, damping, H, g):
    """Schur complement: eliminate the inverse depths of M points from H (D, D) and g (D,).

    ``damping`` is added to the information ``point_h`` (M,). Most elements of ``coupling`` (M, D)
    are zero.
    """
    D = len(g)
    where, values = np.empty(D, np.int64), np.empty(D)
    for j in range(len(point_h)):
        total = point_h[j] + damping
        if not total > 0.0:
            continue
        n = 0
        for i in range(D):
            if coupling[j, i] != 0.0:
                where[n], values[n] = i, coupling[j, i]
                n += 1
        inverse = 1.0 / total
        for i in range(n):
            scaled, row = values[i] * inverse, where[i]
            g[row] -= scaled * point_g[j]
            for k in range(i + 1):
                H[row, where[k]] -= scaled * values[k]
    for i in range(D):
        for k in range(i):
            H[k, i] = H[i, k]


@loop_kernel
def point_variances(rows, coupling, point_h, covariance, variances):
    """Variances (R,) of the inverse depths of the points in ``rows``.

    ``covariance`` (D, D) is the covariance of the unknowns other than the inverse depths.
    """
    D = len(covariance)
    where, values = np.empty(D, np.int64), np.empty(D)
    for r in range(len(rows)):
        j = rows[r]
        n = 0
        for i in range(D):
            if coupling[j, i] != 0.0:
                where[n], values[n] = i, coupling[j, i]
                n += 1
        total = 0.0
        for i in range(n):
            for k in range(n):
                total += values[i] * values[k] * covariance[where[i], where[k]]
        variances[r] = (1.0 + total / point_h[j]) / point_h[j]
