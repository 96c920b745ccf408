"""Kannala-Brandt's fisheye, OpenCV's `fisheye` module, Kalibr's and ROS's "equidistant"."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.curve import MonotonicCurve, first_positive_root
from farpoint.camera.focal import FocalModel, PlaneDerivatives, PlaneJacobian, rays_from_plane
from farpoint.camera.values import finite

__all__ = ["KannalaBrandt"]


@dataclass(frozen=True, kw_only=True)
class KannalaBrandt(FocalModel):
    """Fisheye whose image height is an odd polynomial of the angle off the axis.

    With ``theta = atan2(sqrt(X^2 + Y^2), Z)`` the image height is ``theta (1 + k1 theta^2 + k2
    theta^4 + k3 theta^6 + k4 theta^8)`` focal lengths, in the direction of (X, Y). Points are
    visible up to the angle at which the height stops increasing, which may exceed 90 degrees.

    The model is from Kannala and Brandt, "A generic camera model and calibration method", PAMI
    28(8), 2006, doi:10.1109/TPAMI.2006.153.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    k1, k2, k3, k4 : float
        Coefficients.

    Raises
    ------
    InputError
        For a focal length that is not positive or a number that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> lens = KannalaBrandt(fx=200, fy=200, cx=320, cy=240)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]])).round(3)
    array([[634.159, 240.   ]])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("k1", "k2", "k3", "k4"):
            object.__setattr__(self, name, finite(name, getattr(self, name)))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return "Kannala-Brandt fisheye (equidistant)"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | {"k1": self.k1, "k2": self.k2, "k3": self.k3, "k4": self.k4}

    @cached_property
    def _curve(self) -> MonotonicCurve:
        slope = np.array([1.0, 3 * self.k1, 5 * self.k2, 7 * self.k3, 9 * self.k4])
        return MonotonicCurve(self._height, min(np.sqrt(first_positive_root(slope)), np.pi))

    def _height(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image height in focal lengths, and its slope by the angle off the axis."""
        s = theta * theta
        height = 1.0 + s * (self.k1 + s * (self.k2 + s * (self.k3 + s * self.k4)))
        slope = 1.0 + s * (
            3.0 * self.k1 + s * (5.0 * self.k2 + s * (7.0 * self.k3 + s * (9.0 * self.k4)))
        )
        return theta * height, slope

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        radius = np.sqrt(x * x + y * y)
        theta = np.arctan2(radius, z)
        scale = self._height(theta)[0] / radius
        scale = np.where(radius > 0.0, scale, 1.0 / z)
        scale = np.where(theta < self._curve.end, scale, np.nan)
        return x * scale, y * scale

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        square = x * x + y * y
        radius, distance2 = np.sqrt(square), square + z * z
        height, slope = self._height(np.arctan2(radius, z))
        off_axis = radius > 0.0
        scale = np.where(off_axis, height / radius, 1.0 / z)
        curvature = np.where(off_axis, (slope * z / distance2 - scale) / square, 0.0)
        cross, fall = x * y * curvature, -slope / distance2
        return (
            (scale + x * x * curvature, cross, x * fall),
            (cross, scale + y * y * curvature, y * fall),
        )

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        radius = np.sqrt(x * x + y * y)
        theta = np.arctan2(radius, z)
        over = np.where(radius > 0.0, 1.0 / radius, 0.0)
        powers = [theta**power * over for power in (3, 5, 7, 9)]
        return [(x * power, y * power) for power in powers]

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        height = np.sqrt(a * a + b * b)
        theta = self._curve.invert(height)
        sine = np.sin(theta) / height
        sine = np.where(height > 0.0, sine, 1.0)
        return rays_from_plane(a * sine, b * sine, np.cos(theta))
