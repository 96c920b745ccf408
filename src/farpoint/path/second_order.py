"""Second-order effect of an error of the direction on a position of known distance."""

from __future__ import annotations

import numpy as np

__all__ = ["second_order_variance"]


def second_order_variance(displacement: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Variance (3, 3) of a position of known distance, to second order in the direction's error.

    An error ``e`` across a ``displacement`` (3,) of length l shortens the displacement by ``e . e /
    (2 l)``. If e is normal with the covariance C, the mean square of the shortening is ``(2 tr C^2
    + (tr C)^2) / (4 l^2)``. If the distance l is the unit of the path, the shortening is the only
    error along the displacement. The mean square is returned as the variance of every coordinate,
    because rotation errors of later frames, which are about as large as the error of the direction,
    turn the displacement.
    """
    length2 = float(displacement @ displacement)
    if length2 == 0.0:
        return np.zeros((3, 3))
    P = np.eye(3) - np.outer(displacement, displacement) / length2
    across = P @ covariance @ P
    square = 2.0 * float(np.sum(across**2)) + float(np.trace(across)) ** 2
    return square / (4.0 * length2) * np.eye(3)
