"""Where tracks go next if the camera moves on as it did."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from farpoint.camera import Camera
from farpoint.path.vectors import cross
from farpoint.pose import RelativePose
from farpoint.tracks import Tracks

__all__ = ["inverse_depths", "point_predictor"]


def inverse_depths(
    rays0: np.ndarray, rays1: np.ndarray, R_cam1_from_cam0: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Inverse distances (N,) from camera 1, in units of the translation, of matched rays (N, 3).

    From ``l1 b = l0 R a + t`` and its cross product with ``R a``; negative behind the camera.
    """
    turned = rays0 @ R_cam1_from_cam0.T
    plane_of_motion = cross(direction, turned)
    plane_of_match = cross(rays1, turned)
    square = np.maximum(np.sum(plane_of_motion**2, axis=1), 1e-12)
    return np.sum(plane_of_match * plane_of_motion, axis=1) / square


def point_predictor(
    camera: Camera, motion: RelativePose, tracks: Tracks, ids: np.ndarray, points: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """What tells where the tracks ``ids`` go if the same motion comes once more.

    Parameters
    ----------
    camera : Camera
        Of both images.
    motion : RelativePose
        The last motion; one that FAILED predicts nothing.
    tracks : Tracks
        The matches behind it; they give the depths. A track without is taken to be as far as its
        neighbour in the image.
    ids : ndarray of int64, shape (N,)
        Ascending.
    points : ndarray, shape (N, 2)
        Their pixels now.

    Returns
    -------
    callable
        Takes their pixels now, or others (N, 2) as far away, and returns those to come (N, 2); NaN
        rows where the lens sees none.
    """
    R, direction = motion.rotation_cam1_from_cam0, motion.direction_cam1_from_cam0
    if R is None:
        return lambda points: points
    shift = np.zeros((len(ids), 3))
    if direction is not None and len(tracks) > 0:
        rays0, rays1 = camera.unproject(tracks.points0), camera.unproject(tracks.points1)
        depths = np.maximum(inverse_depths(rays0, rays1, R, direction), 0.0)
        order = np.argsort(tracks.ids)
        found = np.searchsorted(tracks.ids[order], ids)
        row = order[np.minimum(found, len(order) - 1)]
        fresh = tracks.ids[row] != ids
        row[fresh] = _nearest(points[fresh], tracks.points1)
        shift = depths[row, None] * direction
    return lambda points: camera.project(camera.unproject(points) @ R.T + shift)


def _nearest(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """For each of the points (N, 2), which of the others (M, 2), at least one, is nearest."""
    # Squared distances, less what is the same for all of a row.
    return np.argmin(np.sum(others**2, axis=1) - 2.0 * points @ others.T, axis=1)
