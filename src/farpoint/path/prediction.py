"""Prediction of tracks by constant motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry.vectors import cross
from farpoint.pose import RelativePose
from farpoint.tracks import Tracks

__all__ = ["inverse_depths", "point_predictor"]


def inverse_depths(
    rays0: np.ndarray, rays1: np.ndarray, R_cam1_from_cam0: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Inverse distances (N,) of points from camera 1, from matched rays (N, 3).

    The unit of length is the translation, ``t = direction``. A point on the unit rays a and b of a
    match has the distances l0 and l1 from the cameras, with ``l1 b = l0 R a + t``. The cross
    product of this equation with ``R a`` gives ``1 / l1``, negative for a point behind camera 1.
    """
    rotated = rays0 @ R_cam1_from_cam0.T
    plane_of_motion = cross(direction, rotated)
    plane_of_match = cross(rays1, rotated)
    square = np.maximum(np.einsum("nk,nk->n", plane_of_motion, plane_of_motion), 1e-12)
    return np.einsum("nk,nk->n", plane_of_match, plane_of_motion) / square


def point_predictor(
    camera: Camera, motion: RelativePose, tracks: Tracks, ids: np.ndarray, points: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Function that predicts the tracks ``ids`` under the assumption that the motion repeats.

    Parameters
    ----------
    camera : Camera
        Camera of both images.
    motion : RelativePose
        The last motion. A motion with status FAILED predicts no displacement.
    tracks : Tracks
        Matches of the last motion, from which depths are triangulated. A track without a match gets
        the depth of the match that is nearest in the image.
    ids : ndarray of int64, shape (N,)
        Ids of the predicted tracks, ascending.
    points : ndarray, shape (N, 2)
        Current pixels of the tracks.

    Returns
    -------
    callable
        Maps current pixels (N, 2) of the tracks, or pixels close to these, to expected pixels (N,
        2) in the next image. Rows are NaN for points outside the lens' field.
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
    """Index (N,) of the nearest of the other points (M, 2) to each of the points (N, 2)."""
    # Squared distances up to a constant of each row.
    return np.argmin(np.sum(others**2, axis=1) - 2.0 * points @ others.T, axis=1)
