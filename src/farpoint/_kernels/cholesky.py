"""Solution of normal equations by Cholesky's factor, for the kernels that call these functions."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import step_kernel
from farpoint._kernels.constants import LEAST_INFORMATION

__all__ = ["factorised", "solved"]


@step_kernel
def factorised(H: np.ndarray, damping: float, unit: np.ndarray, L: np.ndarray) -> bool:
    """Cholesky factor L (D, D) of ``S H S + damping I``, where S scales ``H`` to a unit diagonal.

    ``S = diag(unit)``. Results: ``unit`` (D,), and the lower triangle of L.

    Returns
    -------
    bool
        Whether the scaled matrix is positive definite.
    """
    n = len(H)
    for i in range(n):
        unit[i] = 1.0 / math.sqrt(max(H[i, i], LEAST_INFORMATION))
    for i in range(n):
        for j in range(i + 1):
            total = H[i, j] * unit[i] * unit[j]
            if i == j:
                total += damping
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > 0.0 and total < math.inf:
                L[i, i] = math.sqrt(total)
            else:
                return False
    return True


@step_kernel
def solved(L: np.ndarray, unit: np.ndarray, g: np.ndarray, x: np.ndarray) -> None:
    """Solve ``H x = g`` with the factor ``L, unit`` of H from `factorised`."""
    n = len(g)
    for i in range(n):
        total = g[i] * unit[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        x[i] /= L[i, i]
        for k in range(i):
            x[k] -= L[i, k] * x[i]
    for i in range(n):
        x[i] *= unit[i]
