"""The FOV model of Devernay and Faugeras: a distortion with one parameter, an arctangent."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.focal import FocalModel, PlaneDerivatives, PlaneJacobian, rays_from_plane
from farpoint.camera.values import within

__all__ = ["Arctangent"]


@dataclass(frozen=True, kw_only=True)
class Arctangent(FocalModel):
    """Lens whose image height is ``atan(2 tan(omega / 2) sqrt(X^2 + Y^2) / Z) / omega``.

    The image height is in focal lengths, in the direction of (X, Y).

    COLMAP and Kalibr call this lens FOV. PTAM and DSO call this lens ATAN. Points with ``Z <= 0``
    are not visible.

    The model is from Devernay and Faugeras, "Straight lines have to be straight", Machine Vision
    and Applications 13, 2001, doi:10.1007/PL00013269.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    omega : float
        Distortion parameter, rad, above 0 and below pi. In the limit 0 the lens is a pinhole.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Arctangent(fx=300, fy=300, cx=320, cy=240, omega=1.0)
    >>> lens.project(np.array([[1.0, 0.0, 1.0]])).round(3)
    array([[568.887, 240.   ]])
    """

    omega: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "omega", within("omega", self.omega, 1e-6, np.pi - 1e-6))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return "FOV (arctangent)"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | {"omega": self.omega}

    @cached_property
    def _stretch(self) -> float:
        return float(2.0 * np.tan(self.omega / 2.0))

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        z = np.where(z > 0.0, z, np.nan)
        radius = np.sqrt(x * x + y * y)
        scale = np.arctan2(self._stretch * radius, z) / (self.omega * radius)
        scale = np.where(radius == 0.0, self._stretch / (self.omega * z), scale)
        return x * scale, y * scale

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        square = x * x + y * y
        radius = np.sqrt(square)
        off_axis = radius > 0.0
        angle = np.arctan2(self._stretch * radius, z)
        # d angle / d radius = slope z, d angle / dz = -slope radius.
        slope = self._stretch / (z * z + self._stretch**2 * square)
        scale = np.where(off_axis, angle / radius, self._stretch / z) / self.omega
        curvature = np.where(off_axis, (slope * z / self.omega - scale) / square, 0.0)
        cross, fall = x * y * curvature, -slope / self.omega
        return (
            (scale + x * x * curvature, cross, x * fall),
            (cross, scale + y * y * curvature, y * fall),
        )

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        square = x * x + y * y
        radius = np.sqrt(square)
        angle = np.arctan2(self._stretch * radius, z)
        scale = np.where(radius > 0.0, angle / radius, self._stretch / z)
        # d stretch / d omega = 1 + stretch^2 / 4, d angle / d stretch = z radius / (...).
        slope_by_radius = z * (1.0 + 0.25 * self._stretch**2) / (z * z + self._stretch**2 * square)
        by_omega = (slope_by_radius - scale / self.omega) / self.omega
        return [(x * by_omega, y * by_omega)]

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        height = np.sqrt(a * a + b * b)
        angle = self.omega * height
        angle = np.where(angle < np.pi / 2.0, angle, np.nan)
        sine = np.where(height > 0.0, np.sin(angle) / height, self.omega)
        return rays_from_plane(a * sine, b * sine, self._stretch * np.cos(angle))
