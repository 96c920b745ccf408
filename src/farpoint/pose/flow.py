"""The translational flow: image motion without the rotation."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera

__all__ = ["derotated_points"]


def derotated_points(
    camera: Camera, points1: np.ndarray, rotation_cam1_from_cam0: np.ndarray
) -> np.ndarray:
    """Points of image 1 without the rotation of the camera, as pixels of image 0.

    The result is the pixels (N, 2) of ``R.T @ ray1``. The flow from ``points0`` to these pixels is
    due to the translation alone and lies on lines through the epipole (Burschka and Mair 2008, eq.
    14). The row of a point is NaN if the lens does not see the point.
    """
    if len(points1) == 0:
        return points1
    return camera.project(camera.unproject(points1) @ rotation_cam1_from_cam0)
