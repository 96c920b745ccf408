"""Covariance of a motion with known length, in the component order of other programs."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry.so3 import skew

__all__ = ["PoseOrder", "pose_covariance_in", "twist_covariance"]


class PoseOrder(StrEnum):
    """Convention of a 6x6 covariance: the pose, the order, and the side of the perturbation."""

    ROS = "ros"
    """``[translation, rotation]`` of the pose of camera 1 in camera 0, both in camera 0's fixed
    axes: ``p_true = p + dp``, ``Q_true = Exp(dphi) @ Q`` with ``p = scale * heading_cam0`` and
    ``Q = R.T``. This is the order of ``geometry_msgs/PoseWithCovariance``."""
    COLMAP = "colmap"
    """``[rotation, translation]`` of ``cam1_from_cam0`` as a twist on the left, in camera 1's axes:
    ``T_true = Exp([dtheta, dtau]) @ T``. This is the order of pycolmap's functions on covariances
    of ``Rigid3d``. GTSAM's twist on the right of the pose of camera 1 in camera 0 is the negative
    of this twist, so the covariance of GTSAM's twist is the same matrix."""


def pose_covariance_in(
    order: PoseOrder, R_cam1_from_cam0: np.ndarray, twist: np.ndarray
) -> np.ndarray:
    """`twist_covariance` (6, 6) in the given order.

    The inverse of ``Exp(xi) @ T`` is ``T^-1 @ Exp(-xi)``. In the fixed axes of camera 0, the
    perturbation of the inverse pose is therefore the twist with rotation and translation each
    multiplied by ``-R.T``.
    """
    if order is PoseOrder.COLMAP:
        return twist
    adjoint = np.zeros((6, 6))
    adjoint[:3, 3:] = adjoint[3:, :3] = -R_cam1_from_cam0.T
    return adjoint @ twist @ adjoint.T


def twist_covariance(
    direction: np.ndarray,
    direction_basis: np.ndarray,
    covariance: np.ndarray,
    scale: float,
    scale_sigma: float,
) -> np.ndarray:
    """Covariance (6, 6) of the left twist ``[dtheta, dtau]`` of ``cam1_from_cam0``.

    With ``t = scale * direction`` and ``t_true = Exp(dtheta) @ t + dtau``, to first order
    ``dtau = dscale * direction + scale * (direction_basis @ dbeta + skew(direction) @ dtheta)``.

    Parameters
    ----------
    direction, direction_basis, covariance : ndarray, shapes (3,), (3, 2), (5, 5)
        Values of a `RelativePose`.
    scale, scale_sigma : float
        Length of the translation and its 1-sigma, in any unit of length; the result has the same
        unit. The error of the length is taken as independent of the errors of rotation and
        direction.

    Raises
    ------
    InputError
        If the scale is not positive or its sigma negative.
    """
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"expected a positive length, got {scale}", field="scale")
    if not (math.isfinite(scale_sigma) and scale_sigma >= 0.0):
        raise InputError(f"expected a 1-sigma, 0 or more, got {scale_sigma}", field="scale_sigma")
    jacobian = np.zeros((6, 6))  # of [dtheta, dtau] by [dtheta, dbeta, dscale]
    jacobian[:3, :3] = np.eye(3)
    jacobian[3:, :3] = scale * skew(direction)
    jacobian[3:, 3:5] = scale * direction_basis
    jacobian[3:, 5] = direction
    known = np.zeros((6, 6))
    known[:5, :5] = covariance
    known[5, 5] = scale_sigma**2
    return jacobian @ known @ jacobian.T
