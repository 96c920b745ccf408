"""Input of every estimator: the matches of two views, with the true motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera import Camera
from farpoint.synthetic import PointScene
from farpoint.synthetic.pairs import HardPair

__all__ = ["TwoViews", "evenly_spaced", "views_of_scene"]


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoViews:
    """Matches between two images of one camera, with the truth.

    Attributes
    ----------
    camera : Camera
        Camera that took both images.
    points0, points1 : ndarray of float64, shape (N, 2)
        Pixels; the centre of the top-left pixel is (0, 0).
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
    translation_cam1_from_cam0 : ndarray, shape (3,)
        The true motion, in any unit of length.
    """

    camera: Camera
    points0: np.ndarray
    points1: np.ndarray
    rotation_cam1_from_cam0: np.ndarray
    translation_cam1_from_cam0: np.ndarray


def views_of_scene(scene: PointScene | HardPair) -> TwoViews:
    """The matches of a scene, which are the input of estimators, and the true motion."""
    return TwoViews(
        camera=scene.camera,
        points0=scene.points0,
        points1=scene.points1,
        rotation_cam1_from_cam0=scene.rotation_cam1_from_cam0,
        translation_cam1_from_cam0=scene.translation_cam1_from_cam0,
    )


def evenly_spaced(total: int, most: int) -> np.ndarray:
    """At most ``most`` of the numbers from 0 to ``total - 1``, evenly spaced."""
    return np.unique(np.linspace(0, total - 1, min(most, total)).astype(int))
