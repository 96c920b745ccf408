"""How near the points of a motion are, in units of its translation, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.pose import RelativePose, TrackLabel
from farpoint.tracks import Tracks

__all__ = ["InverseDistances", "Parallax", "measure_parallax"]

_NEAR_EPIPOLE = 1e-3  # rad: no parallax can be seen this near to the direction of travel


class InverseDistances(NamedTuple):
    """Inverse distances of the points of a motion from camera 0, its translation being the unit.

    Attributes
    ----------
    inverse : ndarray, shape (N,)
        Negative by noise.
    variance : ndarray, shape (N,)
        What the noise of the match adds.
    by_motion : ndarray, shape (N, 5)
        By how much it would be smaller, per radian, had the motion been another one by
        ``[dtheta, dbeta]``: an error that all points of the motion share.
    """

    inverse: np.ndarray
    variance: np.ndarray
    by_motion: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Parallax:
    """Angles by which a translation has moved points, each alone.

    A point at the inverse distance k, in units of the translation, is seen along ``turned + k t``,
    at the angle ``atan2(k sin, 1 + k cos)`` from ``turned`` towards ``t``.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Ascending.
    turned : ndarray, shape (N, 3)
        Rays of camera 0 in the axes of camera 1, ``R_cam1_from_cam0 @ ray0``.
    direction, basis : ndarray, shapes (3,), (3, 2)
        ``t`` and its tangent basis.
    cos, sin : ndarray, shape (N,)
        Of the angle between ``turned`` and ``t``.
    angle, variance : ndarray, shape (N,)
        Measured, rad, with its noise, rad^2.
    """

    ids: np.ndarray
    turned: np.ndarray
    direction: np.ndarray
    basis: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    angle: np.ndarray
    variance: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, which: np.ndarray) -> Parallax:
        """Those of a mask or of indices."""
        return replace(
            self,
            **{
                name: getattr(self, name)[which]
                for name in ("ids", "turned", "cos", "sin", "angle", "variance")
            },
        )

    def measured(self) -> np.ndarray:
        """Inverse distances (N,) that make the angles what they are."""
        rest = self.sin * np.cos(self.angle) - self.cos * np.sin(self.angle)
        return np.sin(self.angle) / np.where(np.abs(rest) > _NEAR_EPIPOLE, rest, _NEAR_EPIPOLE)

    def around(self, expected: np.ndarray) -> InverseDistances:
        """Inverse distances, to first order around what is expected of each (N,).

        The noise of the angle is even, that of the inverse distance is not: taken around what was
        measured, points seen too near would weigh more, and the scale would grow with every motion.
        """
        square = 1.0 + 2.0 * expected * self.cos + expected**2
        slope = self.sin / square
        angle = np.arctan2(expected * self.sin, 1.0 + expected * self.cos)
        length = np.sqrt(square)[:, None]
        rays = (self.turned + expected[:, None] * self.direction) / length
        along = self.direction - (rays @ self.direction)[:, None] * rays
        along /= np.maximum(_lengths(along), _NEAR_EPIPOLE)[:, None]
        # Along the line, the ray moves with dtheta x turned + expected * basis @ dbeta.
        moved = np.hstack([_cross(self.turned, along), expected[:, None] * (along @ self.basis)])
        return InverseDistances(
            inverse=expected + (self.angle - angle) / slope,
            variance=self.variance / slope**2,
            by_motion=moved / (length * slope[:, None]),
        )


def measure_parallax(camera: Camera, tracks: Tracks, motion: RelativePose) -> Parallax:
    """The angle of each good match along its epipolar line.

    The flow across the line says nothing of the distance, and is where the motion came from.

    Parameters
    ----------
    camera : Camera
        Of both frames.
    tracks : Tracks
        The matches behind the motion, aligned with its labels.
    motion : RelativePose
        Of status OK.
    """
    R, t, basis = (
        motion.rotation_cam1_from_cam0,
        motion.direction_cam1_from_cam0,
        motion.direction_basis,
    )
    assert R is not None
    assert t is not None
    assert basis is not None
    tracks = tracks.select(motion.labels != TrackLabel.OUTLIER)
    tracks = tracks.select(np.argsort(tracks.ids))
    rays1 = camera.unproject(tracks.points1)
    turned = camera.unproject(tracks.points0) @ R.T
    cos = turned @ t
    towards = t - cos[:, None] * turned
    sin = np.linalg.norm(towards, axis=1)
    seen = sin > _NEAR_EPIPOLE
    tracks, rays1, turned, cos, sin = (
        tracks.select(seen),
        rays1[seen],
        turned[seen],
        cos[seen],
        sin[seen],
    )
    towards = towards[seen] / sin[:, None]
    along = t - (rays1 @ t)[:, None] * rays1
    along /= np.maximum(np.linalg.norm(along, axis=1), _NEAR_EPIPOLE)[:, None]
    per_px = np.einsum("ni,nij->nj", along, camera.unproject_jacobian(rays1))
    return Parallax(
        ids=tracks.ids,
        turned=turned,
        direction=t,
        basis=basis,
        cos=cos,
        sin=sin,
        angle=np.arctan2(np.sum(rays1 * towards, axis=1), np.sum(rays1 * turned, axis=1)),
        variance=np.einsum("ni,nij,nj->n", per_px, _noise_px2(tracks, motion), per_px),
    )


def _noise_px2(tracks: Tracks, motion: RelativePose) -> np.ndarray:
    """Covariances (N, 2, 2) of the displacements, with the noise that the motion has found."""
    covariance = tracks.covariance_px2
    if motion.noise_px is None or not len(tracks):
        return covariance
    # The estimate knows them up to a factor; each image has half of the displacement's.
    typical = 0.25 * float(np.median(np.trace(covariance, axis1=1, axis2=2)))
    return covariance * (motion.noise_px**2 / typical)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (N, 3); NumPy's takes five times as long over arrays as small as these."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _lengths(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ni,ni->n", a, a))
