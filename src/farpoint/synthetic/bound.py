"""Cramer-Rao bound of the motion in a point scene."""

from __future__ import annotations

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import sphere
from farpoint.synthetic.points import PointScene

__all__ = ["cramer_rao_bound", "rotation_cramer_rao_bound"]


def cramer_rao_bound(scene: PointScene) -> np.ndarray:
    """Least covariance of ``[dtheta (3), dbeta (2)]``, rad^2, of an unbiased estimate.

    All inliers, near and far, contribute. The estimator is assumed to know which matches are
    inliers, and the noise. The unknowns are the pose and the three coordinates of every scene
    point. The rotation is perturbed on the left, and the direction in its tangent plane
    ``sphere.tangent_basis(direction)``. Every point is observed in two images with normal noise.
    The points are eliminated by the Schur complement. For each point, A is the Jacobian of the
    pixel in image 1 with respect to the pose, and U and V are the Jacobians of the pixels in image
    1 and image 0 with respect to the point. The sum is over all points::

        information = sum A.T (I - U (U.T U + V.T V)^-1 U.T) A / noise^2

    Returns
    -------
    ndarray, shape (5, 5)

    Raises
    ------
    InputError
        If the bound of the direction does not exist: the scene has no translation, no noise or too
        few matches.
    """
    direction = scene.direction_cam1_from_cam0
    if direction is None:
        raise InputError("expected a scene with translation", field="scene")
    true = ~scene.is_outlier
    rays0, inverse_depth = scene.true_rays0[true], 1.0 / scene.depths[true]
    rotated = rays0 @ scene.rotation_cam1_from_cam0.T
    # All terms are divided by the depth, so points at infinity are included.
    shift = np.linalg.norm(scene.translation_cam1_from_cam0) * inverse_depth[:, None]
    project1 = scene.camera.model.project_jacobian(rotated + shift * direction)
    by_direction = shift[:, :, None] * sphere.tangent_basis(direction)
    by_pose = project1 @ np.concatenate([_cross_matrices(-rotated), by_direction], axis=2)
    # The coordinates of a point are two angles of its ray and its inverse depth, which are finite
    # for a point at infinity, too.
    basis = sphere.tangent_basis(rays0)
    by_ray1 = scene.rotation_cam1_from_cam0 @ basis
    by_inverse_depth = np.broadcast_to(
        scene.translation_cam1_from_cam0[:, None], (len(rays0), 3, 1)
    )
    by_point1 = project1 @ np.concatenate([by_ray1, by_inverse_depth], axis=2)
    by_point0 = np.zeros_like(by_point1)
    by_point0[:, :, :2] = scene.camera.model.project_jacobian(rays0) @ basis
    return _invert(_information(by_pose, by_point1, by_point0), scene.noise_px)


def rotation_cramer_rao_bound(scene: PointScene) -> np.ndarray:
    """Least covariance (3, 3) of ``dtheta``, rad^2, if the motion is known to be a pure rotation.

    Raises
    ------
    InputError
        If the scene has a translation, no noise or fewer than two true matches.
    """
    if scene.direction_cam1_from_cam0 is not None:
        raise InputError("expected a scene without translation", field="scene")
    rays0 = scene.true_rays0[~scene.is_outlier]
    rotated = rays0 @ scene.rotation_cam1_from_cam0.T
    basis = sphere.tangent_basis(rays0)
    project1 = scene.camera.model.project_jacobian(rotated)
    by_pose = project1 @ _cross_matrices(-rotated)
    by_ray1 = project1 @ scene.rotation_cam1_from_cam0 @ basis
    by_ray0 = scene.camera.model.project_jacobian(rays0) @ basis
    return _invert(_information(by_pose, by_ray1, by_ray0), scene.noise_px)


def _information(by_pose: np.ndarray, by_point1: np.ndarray, by_point0: np.ndarray) -> np.ndarray:
    """Information on the pose for noise of 1 px, with the points eliminated."""
    transposed1 = np.swapaxes(by_point1, 1, 2)
    points = transposed1 @ by_point1 + np.swapaxes(by_point0, 1, 2) @ by_point0
    weight = np.eye(2) - by_point1 @ np.linalg.solve(points, transposed1)
    return np.sum(np.swapaxes(by_pose, 1, 2) @ weight @ by_pose, axis=0)


def _invert(information: np.ndarray, noise_px: float) -> np.ndarray:
    if noise_px == 0.0:
        raise InputError("expected a scene with noise", field="scene")
    if np.linalg.matrix_rank(information, hermitian=True) < len(information):
        raise InputError("expected matches that determine the motion", field="scene")
    return np.linalg.inv(information) * noise_px**2


def _cross_matrices(v: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) with ``M[i] @ w == cross(v[i], w)``."""
    return np.cross(v[:, None, :], np.eye(3)).swapaxes(1, 2)
