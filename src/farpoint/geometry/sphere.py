"""Directions: unit vectors, their tangent planes, and steps in these planes."""

from __future__ import annotations

import numpy as np

__all__ = ["angle_between", "confidence_ring", "normalize", "retract", "tangent_basis"]


def normalize(v: np.ndarray) -> np.ndarray:
    """Unit vectors along the last axis of ``v`` (..., 3)."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def tangent_basis(direction: np.ndarray) -> np.ndarray:
    """Orthonormal basis (..., 3, 2) of the plane perpendicular to unit vectors (..., 3).

    The formula has no branches, and no singularities except a change of sign at z = 0: Duff et al.,
    "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    x, y, z = np.moveaxis(direction, -1, 0)
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    second = np.stack([b, sign + y * y * a, -y], axis=-1)
    return np.stack([first, second], axis=-1)


def retract(direction: np.ndarray, basis: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Unit vector ``normalize(direction + basis @ step)``: (3,), (3, 2), (2,) -> (3,)."""
    return normalize(direction + basis @ step)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle, rad, between unit vectors (..., 3); accurate near 0 and near pi."""
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.arctan2(cross, np.sum(a * b, axis=-1))


def confidence_ring(
    direction: np.ndarray, covariance: np.ndarray, confidence: float, points: int = 256
) -> np.ndarray:
    """Boundary of a confidence region of a direction: unit rays (points, 3).

    The last ray equals the first. The boundary is an ellipse in the tangent plane, whose points are
    normalised to unit rays, so that any lens can project the boundary.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector.
    covariance : ndarray, shape (3, 3)
        Covariance of the direction, rad^2. The component along the direction is ignored.
    confidence : float
        Probability of the region, between 0 and 1.
    points : int
        Number of rays.
    """
    basis = tangent_basis(direction)
    variances, axes = np.linalg.eigh(basis.T @ covariance @ basis)
    # In two dimensions the chi-square quantile is closed-form.
    reach = np.sqrt(-2.0 * np.log1p(-confidence) * np.maximum(variances, 0.0))
    turn = np.linspace(0.0, 2.0 * np.pi, points)
    steps = axes @ (reach[:, None] * np.stack([np.cos(turn), np.sin(turn)]))
    return normalize(direction + (basis @ steps).T)
