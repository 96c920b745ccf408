"""A motion as a factor of a GTSAM graph, whose variables are poses ``world_from_cam``.

GTSAM perturbs on the right. A pose is perturbed as ``T @ Exp(xi)``. An essential matrix is
perturbed as ``aRb @ Exp(w)`` and by a step in GTSAM's own tangent basis of the unit direction
``aTb``. Frame ``a`` of GTSAM is camera 0 here, and frame ``b`` is camera 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.geometry.so3 import skew

__all__ = ["between_factor", "essential_matrix_constraint"]


def essential_matrix_constraint(
    key0: int,
    key1: int,
    R_cam1_from_cam0: np.ndarray,
    direction: np.ndarray,
    direction_basis: np.ndarray,
    covariance: np.ndarray,
) -> Any:
    """``gtsam.EssentialMatrixConstraint`` with the covariance (5, 5) of ``[dtheta, dbeta]``.

    ``dtheta`` and ``dbeta`` are those of `RelativePose`. ``aRb = R.T`` is perturbed as ``aRb @
    Exp(w)``, so that ``w = -dtheta``. The change of ``aTb = -R.T @ direction`` is, to first order,
    ``daTb = -R.T @ (skew(direction) @ dtheta + direction_basis @ dbeta)``.
    """
    gtsam = _gtsam()
    heading = gtsam.Unit3(-R_cam1_from_cam0.T @ direction)
    jacobian = np.zeros((5, 5))  # derivative of GTSAM's [w, step] by [dtheta, dbeta]
    jacobian[:3, :3] = -np.eye(3)
    jacobian[3:] = -(R_cam1_from_cam0 @ heading.basis()).T @ np.hstack(
        [skew(direction), direction_basis]
    )
    measured = gtsam.EssentialMatrix(gtsam.Rot3(R_cam1_from_cam0.T), heading)
    noise = gtsam.noiseModel.Gaussian.Covariance(jacobian @ covariance @ jacobian.T)
    return gtsam.EssentialMatrixConstraint(key0, key1, measured, noise)


def between_factor(
    key0: int,
    key1: int,
    R_cam1_from_cam0: np.ndarray,
    translation: np.ndarray,
    twist: np.ndarray,
) -> Any:
    """``gtsam.BetweenFactorPose3``, given the covariance (6, 6) of the twist.

    ``twist`` is the covariance of the left perturbation of ``cam1_from_cam0``.

    The inverse of ``Exp(xi) @ T`` is ``T^-1 @ Exp(-xi)``, and the covariance of ``-xi`` is that of
    ``xi``. GTSAM's covariance is therefore the given matrix.
    """
    gtsam = _gtsam()
    least, *_, largest = np.linalg.eigvalsh(twist)
    if least <= len(twist) * np.finfo(float).eps * largest:  # as in `numpy.linalg.matrix_rank`
        raise InputError("expected more than 0: a factor needs a covariance", field="scale_sigma")
    rotation = gtsam.Rot3(R_cam1_from_cam0.T)
    measured = gtsam.Pose3(rotation, -R_cam1_from_cam0.T @ translation)
    noise = gtsam.noiseModel.Gaussian.Covariance(twist)
    return gtsam.BetweenFactorPose3(key0, key1, measured, noise)


def _gtsam() -> Any:
    return optional_import("gtsam", extra="gtsam", purpose="a factor for GTSAM")
