"""The translational flow: image motion without the rotation."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera

__all__ = ["derotated_points"]


def derotated_points(
    camera: Camera, points1: np.ndarray, rotation_cam1_from_cam0: np.ndarray
) -> np.ndarray:
    """Later points in the earlier image as without the rotation of the camera.

    Pixels (N, 2) of ``R.T @ ray1``; the flow from ``points0`` to them is that of the translation
    alone and lies on lines through the epipole (Burschka and Mair 2008, eq. 14). NaN rows where the
    lens does not see them.
    """
    if len(points1) == 0:
        return points1
    return camera.project(camera.unproject(points1) @ rotation_cam1_from_cam0)
