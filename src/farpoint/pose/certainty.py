"""Largest sigma of a covariance, and the largest sigma at which a rotation is observable."""

from __future__ import annotations

import math

import numpy as np

from farpoint.pose.constants import MAX_ROTATION_SIGMA

__all__ = ["direction_sigma", "fixes_rotation", "largest_sigma"]


def largest_sigma(covariance: np.ndarray) -> float:
    """Square root of the largest eigenvalue: the largest 1-sigma along any axis."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def direction_sigma(covariance: np.ndarray) -> float:
    """The largest 1-sigma, rad, of the direction of a motion with this covariance (5, 5).

    The result equals `largest_sigma` of the block (2, 2) of the direction. The closed form is
    faster, and every motion needs this sigma.
    """
    (xx, xy), (_, yy) = covariance[3:, 3:].tolist()
    half = 0.5 * (xx - yy)
    return math.sqrt(max(0.5 * (xx + yy) + math.sqrt(half * half + xy * xy), 0.0))


def fixes_rotation(rotation_covariance: np.ndarray) -> bool:
    """Whether the largest sigma of a covariance (3, 3), rad^2, is below `MAX_ROTATION_SIGMA`."""
    xx, yy, zz = rotation_covariance.diagonal().tolist()
    trace = xx + yy + zz
    if trace < MAX_ROTATION_SIGMA**2:  # the sum of all eigenvalues
        return True
    return math.isfinite(trace) and largest_sigma(rotation_covariance) < MAX_ROTATION_SIGMA
