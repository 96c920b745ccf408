"""Matches of two views with the true motion, and the camera of most pairs of this package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera import Camera
from farpoint.synthetic.points import PointScene

__all__ = ["HardPair", "of_scene", "seen", "vga_camera"]


@dataclass(frozen=True, kw_only=True, eq=False)
class HardPair:
    """Matches of two views of one camera, with the true motion.

    Attributes
    ----------
    camera : Camera
        Camera of both images.
    points0, points1 : ndarray, shape (N, 2)
        Pixels with noise.
    is_outlier : ndarray of bool, shape (N,)
        Whether a match does not follow the motion of the camera.
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
    translation_cam1_from_cam0 : ndarray, shape (3,)
        ``X_cam1 = R @ X_cam0 + translation``, m.
    """

    camera: Camera
    points0: np.ndarray
    points1: np.ndarray
    is_outlier: np.ndarray
    rotation_cam1_from_cam0: np.ndarray
    translation_cam1_from_cam0: np.ndarray

    def __len__(self) -> int:
        return len(self.points0)


def vga_camera() -> Camera:
    """640x480 camera with a focal length of 500 px."""
    return Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


def of_scene(
    scene: PointScene, points1: np.ndarray, is_outlier: np.ndarray | None = None
) -> HardPair:
    """A point scene as a pair, with ``points1`` instead of the scene's points in image 1."""
    return HardPair(
        camera=scene.camera,
        points0=scene.points0,
        points1=points1,
        is_outlier=scene.is_outlier if is_outlier is None else is_outlier,
        rotation_cam1_from_cam0=scene.rotation_cam1_from_cam0,
        translation_cam1_from_cam0=scene.translation_cam1_from_cam0,
    )


def seen(
    camera: Camera,
    points0: np.ndarray,
    depth: np.ndarray,
    R: np.ndarray,
    translation: np.ndarray,
    rng: np.random.Generator,
    noise_px: float,
) -> HardPair:
    """The pair of views of the points that lie in front of both cameras.

    Parameters
    ----------
    points0 : ndarray, shape (N, 2)
        Pixels in image 0 without noise.
    depth : ndarray, shape (N,)
        Distance from camera 0 along the ray, m; negative behind the camera.
    R : ndarray, shape (3, 3)
        ``R_cam1_from_cam0``.
    translation : ndarray, shape (3,)
        ``translation_cam1_from_cam0``, m.
    noise_px : float
        1-sigma of the noise on each pixel coordinate in each image, px.
    """
    rays = camera.unproject(points0)
    points1 = camera.project(depth[:, None] * rays @ R.T + translation)
    visible = np.isfinite(points1).all(axis=1) & (depth > 0.0)
    noise = rng.normal(0.0, noise_px, (2, np.count_nonzero(visible), 2))
    return HardPair(
        camera=camera,
        points0=points0[visible] + noise[0],
        points1=points1[visible] + noise[1],
        is_outlier=np.zeros(np.count_nonzero(visible), bool),
        rotation_cam1_from_cam0=R,
        translation_cam1_from_cam0=translation,
    )
