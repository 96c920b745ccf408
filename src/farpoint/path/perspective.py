"""Matches of windows, rid of what perspective does to them, and doubted where no plane fits."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.path.prediction import inverse_depths
from farpoint.path.vectors import products, solutions
from farpoint.tracks import Tracks

__all__ = ["without_perspective"]

_STEP_PX = 4.0  # over which the motion's second differences are taken: half of a window
# Elements of a warp are known to this 1-sigma, where nothing is hidden.
_WARP_SIGMA = 0.01
# 1-sigma of the slope of surfaces: change of the distance's logarithm by an angle, 1 / rad.
_SLOPE = 2.0
_LEAST_METRIC = 1e-15  # rad^2 / px^2
_LARGEST_SHIFT_PX = 0.2  # more than perspective does
# 1-sigma of a match, px, for each unit by which its window's warp is none of a plane: as measured
# on rendered streets, through each of four lenses.
_PX_PER_CONTRADICTION = 1.2
_LARGEST_CONTRADICTION = 0.2  # no worse than that: the window was found, after all


def without_perspective(
    tracks: Tracks, camera: Camera, R_cam1_from_cam0: np.ndarray, direction: np.ndarray | None
) -> Tracks:
    """Put matches where they would be, had the windows moved as the affine model has it.

    A plane that comes nearer is magnified the more the nearer it is: in a window its motion has a
    quadratic part, which moves the match by a few hundredths of a pixel. All windows on a road, or
    on the walls beside it, are moved alike, which no covariance of single matches tells; over
    hundreds of them it would be the largest error of the motion. How the windows changed their
    shapes tells how the surfaces lie, and these, with the motion, the quadratic part.

    A window across the edge of something near moves in two ways at once, and its match is neither.
    Planes of any slope change the shapes of windows along the flow only: by as much as one was
    changed across it, the covariance of its match grows.

    Parameters
    ----------
    tracks : Tracks
        With their windows.
    camera : Camera
        Of both images.
    R_cam1_from_cam0 : ndarray, shape (3, 3)
        Rotation between the images, as estimated from these tracks; it need not be exact.
    direction : ndarray, shape (3,), or None
        Unit translation in camera 1 axes; None where it is not known.

    Returns
    -------
    Tracks
        Without windows: the correction is made once. Their covariances are larger.
    """
    if tracks.windows is None:
        return tracks
    motion = _Motion(R_cam1_from_cam0, np.zeros(3) if direction is None else direction)
    planes, contradiction = _planes(tracks, camera, motion)
    bent = _quadratic_part(tracks.points0, camera, motion, planes)
    shift = np.einsum("nabc,nbc->na", tracks.windows.quadratic_bias, bent)
    shift[~(np.abs(shift).max(axis=1, initial=0.0) < _LARGEST_SHIFT_PX)] = 0.0
    doubt_px2 = (_PX_PER_CONTRADICTION * contradiction) ** 2
    return replace(
        tracks,
        points1=tracks.points1 - shift,
        covariance_px2=tracks.covariance_px2 + doubt_px2[:, None, None] * np.eye(2),
        windows=None,
    )


class _Motion(NamedTuple):
    """A ray r whose point is at the inverse distance s goes to ``R r + s direction``."""

    R: np.ndarray
    direction: np.ndarray

    def moved(self, rays: np.ndarray, nearness: np.ndarray) -> np.ndarray:
        return rays @ self.R.T + nearness[:, None] * self.direction


def _quadratic_part(
    points: np.ndarray, camera: Camera, motion: _Motion, planes: np.ndarray
) -> np.ndarray:
    """Coefficients (N, 2, 3) of ``u^2``, ``u v``, ``v^2`` in the motion of the pixels around."""
    h = _STEP_PX
    steps = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]])
    rays = camera.unproject((points + steps[:, None]).reshape(-1, 2))
    nearness = np.sum(np.tile(planes, (len(steps), 1)) * rays, axis=1)
    moved = camera.project(motion.moved(rays, nearness)).reshape(len(steps), -1, 2)
    here, right, left, below, above, corner = moved
    uu = (right + left - 2.0 * here) / (2.0 * h**2)
    vv = (below + above - 2.0 * here) / (2.0 * h**2)
    uv = (corner - right - below + here) / h**2
    return np.stack([uu, uv, vv], axis=2)


def _planes(tracks: Tracks, camera: Camera, motion: _Motion) -> tuple[np.ndarray, np.ndarray]:
    """Vectors n (N, 3): the inverse distances around a window are ``n . ray``, as on a plane.

    And by how much (N,) the warps contradict every plane. The warp of a window is the derivative of
    ``project(R ray + direction (n . ray))`` by the pixel: linear in the slope of n, which a prior
    keeps from following noise, and of any slope only along the flow.
    """
    assert tracks.windows is not None
    R, direction = motion
    rays0, rays1 = camera.unproject(tracks.points0), camera.unproject(tracks.points1)
    # Seen from the first camera: the motion backward.
    nearness = np.maximum(inverse_depths(rays1, rays0, R.T, -R.T @ direction), 0.0)
    tangents = camera.unproject_jacobian(rays0)
    ahead = camera.model.project_jacobian(motion.moved(rays0, nearness))
    along = (ahead.reshape(-1, 3) @ direction).reshape(-1, 2)
    rest = tracks.windows.warps - products((ahead.reshape(-1, 3) @ R).reshape(-1, 2, 3), tangents)
    excess = np.einsum("na,nab->nb", along, rest)
    across = np.einsum("na,nab->nb", along[:, ::-1] * [-1.0, 1.0], rest)
    length = np.linalg.norm(along, axis=1)
    contradiction = np.linalg.norm(across, axis=1) / np.where(length > 0.0, length, np.inf)
    # A pixel whose ray does not move tells no slope, and must not end the run.
    metric = products(tangents.transpose(0, 2, 1), tangents) + _LEAST_METRIC * np.eye(2)
    prior = (_SLOPE * nearness) ** 2 * 0.5 * np.trace(metric, axis1=1, axis2=2)
    gain = prior / (prior * np.sum(along**2, axis=1) + _WARP_SIGMA**2)
    slopes = solutions(metric, gain[:, None] * excess)
    planes = nearness[:, None] * rays0 + np.einsum("nib,nb->ni", tangents, slopes)
    # What cannot be told (a lens without derivatives there) is as bad as it gets.
    return planes, np.fmin(contradiction, _LARGEST_CONTRADICTION)
