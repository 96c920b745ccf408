"""A rolling shutter in two views: rays corrected to the time of the middle row of each image.

The rows of an image are read one after the other while the camera moves. A row of phase ``q`` (-1/2
for the first row to 1/2 for the last) is read ``q r`` after the middle row, where ``r`` is the
read-out time. Let ``T`` be the time between the two views, and ``theta`` the rotation vector over
``T``. With constant velocities, the camera has rotated by the share ``q r / T`` of ``theta`` since
the middle row. A ray ``b`` of this row is therefore ``Exp(-q r / T theta) b`` in the axes of the
middle row.

A match is in a row of phase ``q0`` in image 0, and of phase ``q1`` in image 1. The displacement of
the camera between these two rows is ``1 + (q1 - q0) r / T`` times the translation between the
middle rows, and has the same direction. The corrected rays therefore satisfy the epipolar
constraint of a global shutter.

If the velocities change, with constant accelerations, two corrections are added. The angular
velocities at images 0 and 1 are ``(theta - d / 2) / T`` and ``(theta + d / 2) / T``, where ``d`` is
the change of the angular velocity over ``T``, times ``T``. The direction of translation turns by
the rotation vector ``e`` over ``T``: between the two rows of a match, the direction is
``Exp((q0 + q1) / 2 r / T e) t``. Both rays of the match are rotated back by this angle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import VELOCITY_CHANGES
from farpoint._kernels.row_rotation import RowMotion, unroll_rays
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.pose.given import check_camera, checked_rows

__all__ = ["Shutter", "VelocityPrior", "shutter_of"]


class VelocityPrior(NamedTuple):
    """Prior of the changes of the camera's velocity between two views.

    Attributes
    ----------
    before : ndarray, shape (3,), or None
        Rotation vector, rad, in the axes of image 0, over an interval before image 0 as long as the
        time between the views. The expected change of the angular velocity is the rotation between
        the views minus ``before``; 0 for None.
    sigma : float
        1-sigma of each coordinate of the unknown part of the change of the angular velocity, in
        rad, with the time between the views as the unit of time.
    turn_sigma : float
        1-sigma of each coordinate of the turn of the direction of translation, rad.
    """

    before: np.ndarray | None
    sigma: float
    turn_sigma: float = 0.0

    @property
    def sigmas(self) -> np.ndarray:
        """1-sigmas (6,) of `Shutter.changes`."""
        return np.repeat((self.sigma, self.turn_sigma), 3)


class Shutter(NamedTuple):
    """Relative read-out time of two views, and the read-out phases of the matches.

    Attributes
    ----------
    share : float
        Read-out time divided by the time between the views, ``r / T``; negative if the last row is
        read first.
    sigma : float
        1-sigma of ``share``.
    phase0, phase1 : ndarray, shape (N,)
        Phases of the rows in each image, -1/2 to 1/2.
    phase_per_px : float
        Change of the phase from one row to the next.
    prior : VelocityPrior or None
        Prior of the changes of the velocity; None if the velocity is constant.
    changes : ndarray, shape (6,)
        Change of the angular velocity (3) minus its expected value, and turn of the direction of
        translation (3), rad.
    """

    share: float
    sigma: float
    phase0: np.ndarray
    phase1: np.ndarray
    phase_per_px: float
    prior: VelocityPrior | None = None
    changes: np.ndarray = np.zeros(VELOCITY_CHANGES)

    def rate(self, theta: np.ndarray, image: int) -> np.ndarray:
        """Angular velocity (3,) at the middle row of image 0 or 1.

        The unit is rad per time between the views.
        """
        change = self.changes[:3]
        if self.prior is not None and self.prior.before is not None:
            change = change + theta - self.prior.before
        return theta + (image - 0.5) * change

    def phases(self, image: int) -> np.ndarray:
        """Phases (N,) of the rows in image 0 or 1."""
        return (self.phase0, self.phase1)[image]

    @property
    def mean_phases(self) -> np.ndarray:
        """Mean phases (N,) of the two rows of each match."""
        return 0.5 * (self.phase0 + self.phase1)

    def unrolled(
        self, theta: np.ndarray, image: int, rays: np.ndarray, by_pixel: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rays (N, 3) of image 0 or 1 in the axes of the middle row of that image.

        ``theta`` is the rotation vector between the views. The function also returns the
        derivatives (N, 3, 2) of the rays by the pixel, which take into account that the next lower
        row is read later.
        """
        unrolled = np.empty((len(rays), 3)), np.empty((len(rays), 3, 2))
        times = self.phases(image), self.mean_phases
        unroll_rays(rays, by_pixel, *times, self.motion(theta, image), *unrolled)
        return unrolled

    def motion(self, theta: np.ndarray, image: int) -> RowMotion:
        """Motion of the camera while image 0 or 1 is read.

        The derivatives are those by the error of the read-out time in units of one sigma. The turn
        of the direction is given in the axes of image 1.
        """
        rate, turn = self.rate(theta, image), self.changes[3:]
        if image == 0:
            turn = so3.exp(-theta) @ turn
        return RowMotion(
            self.share * rate,
            self.share * turn,
            self.sigma * rate,
            self.sigma * turn,
            self.phase_per_px,
        )

    def time_between(self, rows: np.ndarray) -> float:
        """Mean time between the two rows of a match, divided by the time between the middle rows.

        The mean is over the matches ``rows``.
        """
        apart = self.phase1[rows] - self.phase0[rows]
        return 1.0 + self.share * float(np.mean(apart)) if len(apart) else 1.0


def shutter_of(
    camera: Camera,
    points0: np.ndarray,
    points1: np.ndarray,
    readout_s: float | None,
    interval_s: float | None,
    prior: VelocityPrior | None = None,
) -> Shutter | None:
    """The shutter of matches (N, 2); None if the shutter is global or unknown.

    If ``readout_s`` is None, the read-out time and its 1-sigma are those of the camera.

    Raises
    ------
    InputError
        If points or times are invalid, if ``readout_s`` is given without ``interval_s``, or if the
        camera has no image size.
    """
    if readout_s is None and interval_s is None:
        return None
    check_camera("camera0", camera)
    points0 = checked_rows("points0", points0, (2,))
    points1 = checked_rows("points1", points1, (2,), rows=len(points0))
    sigma_s = 0.0
    if readout_s is None:
        if interval_s is None or camera.readout_s is None:
            return None
        readout_s, sigma_s = camera.readout_s, camera.readout_sigma_s or 0.0
    elif interval_s is None:
        raise InputError("expected the time between the two views, too", field="interval_s")
    for name, value in (("readout_s", readout_s), ("interval_s", interval_s)):
        if not (isinstance(value, int | float | np.number) and math.isfinite(value)):
            raise InputError(f"expected seconds, got {value!r}", field=name)
    if interval_s <= 0.0:
        raise InputError(f"expected positive seconds, got {interval_s!r}", field="interval_s")
    if abs(readout_s) > interval_s:
        raise InputError(
            f"expected no more than the {interval_s:g} s between the views, got {readout_s:g}",
            field="readout_s",
        )
    if readout_s == 0.0 and sigma_s == 0.0:
        return None
    if camera.size is None:
        raise InputError("expected one with its size, which has the rows", field="camera0")
    per_px = 1.0 / max(camera.size[1] - 1, 1)
    phase0, phase1 = (points[:, 1] * per_px - 0.5 for points in (points0, points1))
    share, sigma = float(readout_s / interval_s), float(sigma_s / interval_s)
    return Shutter(share, sigma, phase0, phase1, per_px, prior)
