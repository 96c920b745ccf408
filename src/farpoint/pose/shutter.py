"""A rolling shutter in two views: rays corrected to the time of the middle row of each image.

The rows of an image are read one after the other while the camera rotates. A row of phase ``q``
(-1/2 for the first row to 1/2 for the last) is read ``q r`` after the middle row, where ``r`` is
the read-out time. The velocities are constant over the time ``T`` between the two views, and
``theta`` is the rotation vector over ``T``. When the row is read, the camera has rotated by the
share ``q r / T`` of ``theta`` since the middle row. A ray ``b`` of this row is therefore
``Exp(-q r / T theta) b`` in the axes of the middle row.

A match is in a row of phase ``q0`` in image 0, and of phase ``q1`` in image 1. The displacement of
the camera between these two rows is ``1 + (q1 - q0) r / T`` times the translation between the
middle rows, and has the same direction. The corrected rays therefore satisfy the epipolar
constraint of a global shutter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.lens_errors import RowMotion
from farpoint._kernels.row_rotation import unroll_rays
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.pose.matches import check_camera, checked_rows

__all__ = ["AngularVelocityPrior", "Shutter", "shutter_of"]


class AngularVelocityPrior(NamedTuple):
    """Prior of the camera's angular velocity at the two views.

    Let w(t) be the angular velocity, with image 0 at t = 0 and image 1 at t = 1. If the mean of w
    over (-1, 0) is known, the prior is linear in time, and has the known means over (-1, 0) and (0,
    1). Otherwise the prior is constant, and equals the mean over (0, 1). The errors of the prior
    follow from a Taylor series. True w(0) and w(1) minus the linear prior are -1/6 and 1/3 times
    the second derivative of w. True w(0) and w(1) minus the constant prior are -1/2 and 1/2 times
    the first derivative of w.

    Attributes
    ----------
    before : ndarray, shape (3,), or None
        Rotation vector, rad, in the axes of image 0, over an interval before image 0 as long as the
        time between the views.
    sigma : float
        1-sigma of each coordinate of the unknown derivative of the angular velocity, in rad, with
        the time between the views as the unit of time.
    """

    before: np.ndarray | None
    sigma: float

    @property
    def by_derivative(self) -> tuple[float, float]:
        """Factors by which the unknown derivative changes the angular velocity at images 0, 1."""
        return (-0.5, 0.5) if self.before is None else (-1.0 / 6.0, 1.0 / 3.0)

    def largest_error(self) -> float:
        """The larger 1-sigma of the angular velocity: that at image 0 or that at image 1."""
        return self.sigma * max(map(abs, self.by_derivative))


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
    angular_prior : AngularVelocityPrior or None
        Prior of the angular velocity; None if the angular velocity is constant.
    derivative : ndarray, shape (3,)
        Value of the unknown derivative of the angular velocity (`AngularVelocityPrior`), in rad,
        with the time between the views as the unit of time.
    """

    share: float
    sigma: float
    phase0: np.ndarray
    phase1: np.ndarray
    phase_per_px: float
    angular_prior: AngularVelocityPrior | None = None
    derivative: np.ndarray = np.zeros(3)

    @property
    def angular_prior_sigma(self) -> float:
        """1-sigma of each coordinate of ``derivative``."""
        return 0.0 if self.angular_prior is None else self.angular_prior.sigma

    def rate(self, theta: np.ndarray, image: int) -> np.ndarray:
        """Angular velocity (3,) at the middle row of image 0 or 1.

        The unit is rad per time between the views.
        """
        if self.angular_prior is None:
            return theta
        rate = theta + self.angular_prior.by_derivative[image] * self.derivative
        if self.angular_prior.before is None:
            return rate
        return rate + (image - 0.5) * (theta - self.angular_prior.before)

    def phases(self, image: int) -> np.ndarray:
        """Phases (N,) of the rows in image 0 or 1."""
        return (self.phase0, self.phase1)[image]

    def unrolled(
        self, theta: np.ndarray, image: int, rays: np.ndarray, by_pixel: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rays (N, 3) of image 0 or 1 in the axes of the middle row of that image.

        ``theta`` is the rotation vector between the views. The function also returns the
        derivatives (N, 3, 2) of the rays by the pixel, which take into account that the next lower
        row is read later.
        """
        rate, unrolled = (
            self.share * self.rate(theta, image),
            (np.empty((len(rays), 3)), np.empty((len(rays), 3, 2))),
        )
        unroll_rays(rays, by_pixel, self.phases(image), rate, self.phase_per_px, *unrolled)
        return unrolled

    def motion(self, theta: np.ndarray, image: int) -> RowMotion:
        """Rotation of the camera while image 0 or 1 is read, and its derivatives by errors.

        The errors of the read-out time and of `derivative` are in units of one sigma.
        """
        rate = self.rate(theta, image)
        by_derivative = 0.0
        if self.angular_prior is not None:
            factor = self.angular_prior.by_derivative[image]
            by_derivative = self.share * factor * self.angular_prior.sigma
        return RowMotion(self.share * rate, self.sigma * rate, by_derivative, self.phase_per_px)

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
    angular_prior: AngularVelocityPrior | None = None,
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
    return Shutter(share, sigma, phase0, phase1, per_px, angular_prior)
