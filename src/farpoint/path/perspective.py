"""Correction of matches for perspective distortion of their windows.

If a window does not show a single plane, the covariance of the match is increased.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry.vectors import products, solutions
from farpoint.path.constants import (
    MAX_CORRECTION_PX,
    MAX_WARP_MISFIT,
    MIN_TANGENT_METRIC,
    PX_PER_WARP_MISFIT,
    SLOPE_SIGMA,
    WARP_SIGMA,
)
from farpoint.path.prediction import inverse_depths
from farpoint.tracks import Tracks
from farpoint.tracks.constants import WARP_STEP_PX

__all__ = ["without_perspective"]


def without_perspective(
    tracks: Tracks, camera: Camera, R_cam1_from_cam0: np.ndarray, direction: np.ndarray | None
) -> Tracks:
    """Correct matches for the quadratic part of perspective motion within their windows.

    The matched warp is affine, but the motion of a slanted plane in a window also has a quadratic
    part, which biases the match by 0.01 to 0.05 px. The biases of windows on the same road or wall
    are similar, and the covariances of single matches do not include such a common error. The slope
    of the surface in each window is estimated from the warp. The quadratic part follows from the
    slope and the motion of the camera.

    The slope of a plane displaces pixels, and thus changes the warp, only along the epipolar line.
    If the warp also contains displacements across the epipolar line, the window probably shows two
    motions, at a depth edge. The variance of the match is increased by ``(1.2 px * misfit)^2``,
    where the misfit is the norm of the part of the warp across the epipolar line.

    Parameters
    ----------
    tracks : Tracks
        Matches with the deformations of their windows.
    camera : Camera
        Camera of both images.
    R_cam1_from_cam0 : ndarray, shape (3, 3)
        Approximate rotation between the images.
    direction : ndarray, shape (3,), or None
        Approximate direction of translation in the axes of camera 1, a unit vector; None if
        unknown.

    Returns
    -------
    Tracks
        Corrected matches, with covariances that include the misfits. ``windows`` is None.
    """
    if tracks.windows is None:
        return tracks
    motion = _Motion(R_cam1_from_cam0, np.zeros(3) if direction is None else direction)
    planes, misfit = _planes(tracks, camera, motion)
    quadratic = _quadratic_coefficients(tracks.points0, camera, motion, planes)
    shift = np.einsum("nabc,nbc->na", tracks.windows.quadratic_bias, quadratic)
    shift[~(np.abs(shift).max(axis=1, initial=0.0) < MAX_CORRECTION_PX)] = 0.0
    misfit_px2 = (PX_PER_WARP_MISFIT * misfit) ** 2
    return replace(
        tracks,
        points1=tracks.points1 - shift,
        covariance_px2=tracks.covariance_px2 + misfit_px2[:, None, None] * np.eye(2),
        windows=None,
    )


class _Motion(NamedTuple):
    """Motion of points: ray r with the inverse distance s becomes the ray ``R r + s direction``."""

    R: np.ndarray
    direction: np.ndarray

    def updated(self, rays: np.ndarray, nearness: np.ndarray) -> np.ndarray:
        return rays @ self.R.T + np.multiply.outer(nearness, self.direction)


def _quadratic_coefficients(
    points: np.ndarray, camera: Camera, motion: _Motion, planes: np.ndarray
) -> np.ndarray:
    """Coefficients (N, 2, 3) of ``u^2``, ``u v``, ``v^2`` in the motion around each pixel.

    ``u`` and ``v`` are the offsets from the pixel, px.
    """
    h = WARP_STEP_PX
    steps = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]])
    rays = camera.unproject((points + steps[:, None]).reshape(-1, 2))
    nearness = np.einsum("nk,snk->sn", planes, rays.reshape(len(steps), -1, 3)).reshape(-1)
    updated = camera.project(motion.updated(rays, nearness)).reshape(len(steps), -1, 2)
    here, right, left, below, above, corner = updated
    uu = (right + left - 2.0 * here) / (2.0 * h**2)
    vv = (below + above - 2.0 * here) / (2.0 * h**2)
    uv = (corner - right - below + here) / h**2
    return np.stack([uu, uv, vv], axis=2)


def _planes(tracks: Tracks, camera: Camera, motion: _Motion) -> tuple[np.ndarray, np.ndarray]:
    """Plane vectors n (N, 3) of the windows, and misfits (N,) of the warps.

    The inverse distance of a plane along a unit ray is ``n . ray``. The warp of a window is the
    derivative of ``project(R ray + direction (n . ray))`` by the pixel. The slope is the component
    of n across the ray of the window's centre. The warp is linear in the slope, which has a normal
    prior and displaces pixels only along the epipolar line. Let E (2, 2) be the matched warp minus
    the warp without slope, and e (2,) the unit normal of the epipolar line in image 1. The misfit
    is the norm of ``e^T E``.
    """
    assert tracks.windows is not None
    R, direction = motion
    rays0, rays1 = camera.unproject(tracks.points0), camera.unproject(tracks.points1)
    # Inverse distances in camera 0, from the inverse motion.
    nearness = np.maximum(inverse_depths(rays1, rays0, R.T, -R.T @ direction), 0.0)
    tangents = camera.unproject_jacobian(rays0)
    ahead = camera.model.project_jacobian(motion.updated(rays0, nearness))
    along = (ahead.reshape(-1, 3) @ direction).reshape(-1, 2)
    rest = tracks.windows.warps - products((ahead.reshape(-1, 3) @ R).reshape(-1, 2, 3), tangents)
    excess = np.einsum("na,nab->nb", along, rest)
    across = np.einsum("na,nab->nb", along[:, ::-1] * [-1.0, 1.0], rest)
    length = np.hypot(along[:, 0], along[:, 1])
    misfit = np.hypot(across[:, 0], across[:, 1]) / np.where(length > 0.0, length, np.inf)
    # Regularised, because the matrix is singular where the derivative of the ray is zero.
    metric = products(tangents.transpose(0, 2, 1), tangents) + MIN_TANGENT_METRIC * np.eye(2)
    prior = (SLOPE_SIGMA * nearness) ** 2 * 0.5 * (metric[:, 0, 0] + metric[:, 1, 1])
    gain = prior / (prior * length**2 + WARP_SIGMA**2)
    slopes = solutions(metric, gain[:, None] * excess)
    planes = nearness[:, None] * rays0 + np.einsum("nib,nb->ni", tangents, slopes)
    # The misfit is NaN where the lens has no derivatives: `fmin` replaces NaN by the upper bound.
    return planes, np.fmin(misfit, MAX_WARP_MISFIT)
