"""Composition of a camera pose with a relative motion."""

from __future__ import annotations

import numpy as np

from farpoint.pose import RelativePose

__all__ = ["chain", "parts_of"]


def chain(world_from_cam0: np.ndarray, pose: RelativePose, scale: float | None) -> np.ndarray:
    """``world_from_cam1`` (4, 4) from ``world_from_cam0`` (4, 4) and the relative motion.

    Parameters
    ----------
    world_from_cam0 : ndarray, shape (4, 4)
        Pose of camera 0.
    pose : RelativePose
        Motion from camera 0 to camera 1. Unobservable parts of the motion are taken as zero, so
        status FAILED leaves the camera pose unchanged.
    scale : float or None
        Length of the translation in units of the world; None for no translation.
    """
    if pose.rotation_cam1_from_cam0 is None:
        return world_from_cam0
    cam1_from_cam0 = np.eye(4)
    cam1_from_cam0[:3, :3] = pose.rotation_cam1_from_cam0
    if scale is not None and pose.direction_cam1_from_cam0 is not None:
        cam1_from_cam0[:3, 3] = scale * pose.direction_cam1_from_cam0
    cam0_from_cam1 = np.eye(4)
    cam0_from_cam1[:3, :3] = cam1_from_cam0[:3, :3].T
    cam0_from_cam1[:3, 3] = -cam1_from_cam0[:3, :3].T @ cam1_from_cam0[:3, 3]
    return world_from_cam0 @ cam0_from_cam1


def parts_of(motion: RelativePose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation (3, 3), direction (3,) and tangent basis (3, 2) of a motion with status OK."""
    R, t = motion.rotation_cam1_from_cam0, motion.direction_cam1_from_cam0
    basis = motion.direction_basis
    assert R is not None
    assert t is not None
    assert basis is not None
    return R, t, basis
