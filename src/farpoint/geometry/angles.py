"""Motions in degrees with their 1-sigma, for display.

All functions accept stacks and keep the leading axes. NaN input gives NaN output.
"""

from __future__ import annotations

import numpy as np

from farpoint.geometry import so3

__all__ = ["heading_angles_deg", "rotation_vector_deg"]

_SMALL_ANGLE_RAD = 1e-3


def rotation_vector_deg(R: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors and the 1-sigma of their components, deg, both (..., 3).

    Parameters
    ----------
    R : ndarray, shape (..., 3, 3)
        Rotations cam1_from_cam0.
    covariance : ndarray, shape (..., 3, 3)
        Covariance of the left perturbation ``dtheta``, rad^2. The rotation vector changes by the
        inverse left Jacobian of SO(3) times ``dtheta`` (Chirikjian, Stochastic Models 2, 2012, eq.
        10.86).
    """
    known = np.isfinite(R).all((-2, -1))
    vector = np.full(R.shape[:-1], np.nan)
    vector[known] = so3.log(R[known])
    jacobian = _inverse_left_jacobian(vector)
    variance = np.einsum("...ij,...jk,...ik->...i", jacobian, covariance, jacobian)
    return np.rad2deg(vector), np.rad2deg(np.sqrt(variance))


def heading_angles_deg(
    heading: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation of a direction of travel with their 1-sigma, deg, both (..., 2).

    The azimuth is 0 straight ahead, positive to the right, and from -180 to 180. The elevation is
    positive upwards.

    Parameters
    ----------
    heading : ndarray, shape (..., 3)
        Unit vectors in camera axes (x right, y down, z forward).
    covariance : ndarray, shape (..., 3, 3)
        Covariance of the heading, rad^2.
    """
    x, y, z = np.moveaxis(heading, -1, 0)
    level = np.hypot(x, z)
    angles = np.stack([np.arctan2(x, z), np.arctan2(-y, level)], axis=-1)
    zero = np.zeros_like(x)
    # For a direction straight up or down, the azimuth is undefined, and its sigma is infinite.
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.stack([z, zero, -x], axis=-1) / np.square(level)[..., None]
        up = np.stack([zero, -1.0 / level, zero], axis=-1)
        jacobian = np.stack([across, up], axis=-2)
        variance = np.einsum("...ij,...jk,...ik->...i", jacobian, covariance, jacobian)
    return np.rad2deg(angles), np.rad2deg(np.sqrt(variance))


def _inverse_left_jacobian(vector: np.ndarray) -> np.ndarray:
    """``I - W / 2 + c W^2`` with ``W = skew(vector)``: (..., 3) -> (..., 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)
    large = np.where(angle > _SMALL_ANGLE_RAD, angle, 1.0)
    c = np.where(
        angle > _SMALL_ANGLE_RAD,
        1.0 / large**2 - 1.0 / (2.0 * large * np.tan(large / 2.0)),
        1.0 / 12.0 + angle**2 / 720.0,
    )
    W = _skew(vector)
    return np.eye(3) - 0.5 * W + c[..., None, None] * (W @ W)


def _skew(vector: np.ndarray) -> np.ndarray:
    return np.swapaxes(np.cross(vector[..., None, :], np.eye(3)), -1, -2)
