"""Fitzgibbon's division model: undistorted radius ``r / (1 + k r^2)`` of an image radius r."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera.focal import (
    FocalModel,
    PlaneDerivatives,
    PlaneJacobian,
    quotient_derivatives,
    quotient_jacobian,
    rays_from_plane,
)
from farpoint.camera.values import within

__all__ = ["Division"]


@dataclass(frozen=True, kw_only=True)
class Division(FocalModel):
    """Lens for which the ray of a plane point (a, b) has the direction ``(a, b, 1 + k (a^2 +
    b^2))``.

    With ``k < 0`` (barrel distortion) all points are visible except points exactly behind the lens,
    as in a parabolic mirror. With ``k > 0`` points with ``Z > 2 sqrt(k) sqrt(X^2 + Y^2)`` are
    visible.

    The model is from Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens
    distortion", CVPR 2001, doi:10.1109/CVPR.2001.990465. COLMAP calls this model DIVISION.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    k : float
        Coefficient.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Division(fx=300, fy=300, cx=320, cy=240, k=-0.25)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]]))
    array([[920., 240.]])
    """

    k: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "k", within("k", self.k, -1e6, 1e6))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return "division"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | {"k": self.k}

    def _divisor(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """``s = sqrt(Z^2 - 4 k R^2)`` with ``R^2 = X^2 + Y^2``, and the divisor ``(Z + s) / 2``."""
        square = x * x + y * y
        s = np.sqrt(z * z - 4.0 * self.k * square)
        # For Z < 0, Z and s cancel in Z + s.
        return s, np.where(z > 0.0, 0.5 * (z + s), 2.0 * self.k * square / (z - s))

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        s, divisor = self._divisor(x, y, z)
        seen = (s > 0.0) & (divisor > 0.0)
        divisor = np.where(seen, divisor, np.nan)
        return x / divisor, y / divisor

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        s, divisor = self._divisor(x, y, z)
        pull = -2.0 * self.k / s
        return quotient_jacobian(x, y, divisor, (pull * x, pull * y, divisor / s))

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        s, divisor = self._divisor(x, y, z)
        return quotient_derivatives(x, y, divisor, (-(x * x + y * y) / s,))

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        radial_term = self.k * (a * a + b * b)
        # For k > 0 the angle off the axis stops increasing at radial_term = 1.
        depth = np.where(radial_term < 1.0, 1.0 + radial_term, np.nan)
        return rays_from_plane(a, b, depth)
