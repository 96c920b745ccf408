"""The equirectangular picture of the whole sphere, the output of 360-degree cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera.lens_model import LensModel
from farpoint.camera.roles import ParameterRoles
from farpoint.camera.values import positive

__all__ = ["Equirectangular"]


@dataclass(frozen=True, kw_only=True)
class Equirectangular(LensModel):
    """Picture of the whole sphere, with the longitude along the rows and the latitude along the
    columns.

    ``u = width (1/2 + atan2(X, Z) / 2 pi) - 1/2`` and ``v = height (1/2 + atan2(Y, sqrt(X^2 + Z^2))
    / pi) - 1/2``. The middle of the picture is the forward direction, and the upper edge is the
    zenith (-y). The picture is periodic along its rows: a pixel beyond the left or the right edge
    has the ray of the pixel that is one picture width away. A pixel above or below the picture has
    no ray.

    Attributes
    ----------
    width, height : float
        Size of the picture, px.

    Raises
    ------
    InputError
        For a size that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Equirectangular(width=400, height=200)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]]))
    array([[299.5,  99.5]])
    """

    width: float
    height: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))

    @property
    def title(self) -> str:
        """Common name of this projection."""
        return "equirectangular (360 degrees)"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return {"width": self.width, "height": self.height}

    @property
    def roles(self) -> ParameterRoles:
        """Empty roles, because the size of the picture has no error."""
        return ParameterRoles(scale={}, affine=(), center=(), radial=())

    def _project(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        level = np.hypot(x, z)
        pixels = np.empty((len(points), 2))
        pixels[:, 0] = self.width * (0.5 + np.arctan2(x, z) / (2.0 * np.pi)) - 0.5
        pixels[:, 1] = self.height * (0.5 + np.arctan2(y, level) / np.pi) - 0.5
        pixels[~(level + np.abs(y) > 0.0)] = np.nan
        return pixels

    def _unproject(self, pixels: np.ndarray) -> np.ndarray:
        u, v = (pixels[:, 0] + 0.5) / self.width, (pixels[:, 1] + 0.5) / self.height
        longitude = 2.0 * np.pi * (u - 0.5)
        latitude = np.where((v >= 0.0) & (v <= 1.0), np.pi * (v - 0.5), np.nan)
        level = np.cos(latitude)
        rays = np.empty((len(pixels), 3))
        rays[:, 0] = level * np.sin(longitude)
        rays[:, 1] = np.sin(latitude)
        rays[:, 2] = level * np.cos(longitude)
        rays[np.isnan(rays[:, 0])] = np.nan
        return rays

    def _project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        pixels = self._project(points)
        jacobian = np.zeros((len(points), 2, 2))
        jacobian[:, 0, 0] = (pixels[:, 0] + 0.5) / self.width
        jacobian[:, 1, 1] = (pixels[:, 1] + 0.5) / self.height
        jacobian[np.isnan(pixels[:, 0])] = np.nan
        return jacobian

    def _project_jacobian(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        level2 = x * x + z * z
        level, distance2 = np.sqrt(level2), level2 + y * y
        across, down = self.width / (2.0 * np.pi * level2), self.height / (np.pi * distance2)
        flat = np.zeros((len(points), 6))
        flat[:, 0], flat[:, 2] = across * z, -across * x
        flat[:, 3], flat[:, 4], flat[:, 5] = (
            -down * x * y / level,
            down * level,
            -down * z * y / level,
        )
        # At the poles the longitude has no derivative.
        flat[~np.isfinite(flat).all(axis=1)] = np.nan
        return flat
