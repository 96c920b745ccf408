"""How near the points of a motion are, in units of its translation, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.pose import RelativePose, TrackLabel
from farpoint.tracks import Tracks
from farpoint.trajectory.chain import parts_of
from farpoint.trajectory.vectors import cross

__all__ = ["InverseDistances", "Parallax", "displacement_noise_px2", "measure_parallax"]

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
    at the angle ``atan2(k sin, 1 + k cos)`` from ``turned`` towards ``t``. Where the motion changes
    by ``dtheta`` the ray moves along that line by ``dtheta . (turned x t) (1 + k cos) / (l sin)``,
    and by ``-dbeta . (turned @ basis) k (cos + k) / (l sin)`` where it changes by ``dbeta``, with l
    the length of ``turned + k t``.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Ascending.
    turned : ndarray, shape (N, 3)
        Rays of camera 0 in the axes of camera 1, ``R_cam1_from_cam0 @ ray0``.
    by_turn, by_tilt : ndarray, shapes (N, 3), (N, 2)
        ``turned x t`` and ``turned @ basis``, with the tangent basis of ``t``, over ``sin ** 2``.
    cos, sin : ndarray, shape (N,)
        Of the angle between ``turned`` and ``t``.
    angle, variance : ndarray, shape (N,)
        Measured, rad, with its noise, rad^2.
    """

    ids: np.ndarray
    turned: np.ndarray
    by_turn: np.ndarray
    by_tilt: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    angle: np.ndarray
    variance: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, which: np.ndarray) -> Parallax:
        """Those of a mask or of indices."""
        return Parallax(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def measured(self) -> np.ndarray:
        """Inverse distances (N,) that make the angles what they are."""
        rest = self.sin * np.cos(self.angle) - self.cos * np.sin(self.angle)
        return np.sin(self.angle) / np.where(np.abs(rest) > _NEAR_EPIPOLE, rest, _NEAR_EPIPOLE)

    def around(self, expected: np.ndarray) -> InverseDistances:
        """Inverse distances, to first order around what is expected of each (N,).

        The noise of the angle is even, that of the inverse distance is not: taken around what was
        measured, points seen too near would weigh more, and the scale would grow with every motion.
        """
        along = 1.0 + expected * self.cos
        slope = self.sin / (along**2 + (expected * self.sin) ** 2)
        angle = np.arctan2(expected * self.sin, along)
        by_motion = np.empty((len(self), 5))
        by_motion[:, :3] = along[:, None] * self.by_turn
        by_motion[:, 3:] = (expected * (self.cos + expected))[:, None] * -self.by_tilt
        return InverseDistances(
            inverse=expected + (self.angle - angle) / slope,
            variance=self.variance / slope**2,
            by_motion=by_motion,
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
    R, t, basis = parts_of(motion)
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
        by_turn=cross(turned, t) / sin[:, None] ** 2,
        by_tilt=turned @ basis / sin[:, None] ** 2,
        cos=cos,
        sin=sin,
        angle=np.arctan2(np.sum(rays1 * towards, axis=1), np.sum(rays1 * turned, axis=1)),
        variance=np.einsum("ni,nij,nj->n", per_px, displacement_noise_px2(tracks, motion), per_px),
    )


def displacement_noise_px2(tracks: Tracks, motion: RelativePose) -> np.ndarray:
    """Covariances (N, 2, 2) of the displacements, with the noise that the motion has found."""
    covariance = tracks.covariance_px2
    if motion.noise_px is None or not len(tracks):
        return covariance
    # The estimate knows them up to a factor; each image has half of the displacement's.
    typical = 0.25 * float(np.median(np.trace(covariance, axis1=1, axis2=2)))
    return covariance * (motion.noise_px**2 / typical)
