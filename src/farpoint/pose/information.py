"""Inverses of information matrices that may be singular."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.constants import POSE_PARAMETERS, ROUNDING
from farpoint.pose.constants import ROTATION_PARAMETERS
from farpoint.pose.small import inverse_three

__all__ = ["inverse_root", "positive", "symmetric_inverse"]

_LOADED_DIAGONAL = {
    n: np.ones((n, n)) + ROUNDING * np.eye(n) for n in (ROTATION_PARAMETERS, POSE_PARAMETERS)
}


def symmetric_inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix, with huge variances along its null space."""
    inverse = inverse_three(information) if len(information) == 3 else None
    if inverse is not None:
        return positive(inverse)
    if not np.isfinite(information).all():
        return np.full(information.shape, np.inf)
    root = inverse_root(information)
    return positive(root @ root.T)


def inverse_root(information: np.ndarray) -> np.ndarray:
    """Matrix ``W`` such that ``W W^T`` is the inverse of a positive semidefinite matrix.

    Eigenvalues near 0 are replaced by a small positive value, so that the inverse is finite.
    """
    values, vectors = np.linalg.eigh(information)
    return vectors / np.sqrt(np.maximum(values, max(1e-14 * values[-1], 1e-12)))


def positive(covariance: np.ndarray) -> np.ndarray:
    """The covariance with the diagonal multiplied by 1 + 1e-12.

    The factor prevents correlations that equal 1 by rounding.
    """
    return covariance * _LOADED_DIAGONAL[len(covariance)]
