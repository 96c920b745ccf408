"""The part all lens models share: rows in, rows out, and the inverse of the derivative."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from farpoint._kernels.lens import invert_projection
from farpoint.camera.values import in_blocks

__all__ = ["LensModel"]


class LensModel(ABC):
    """Implements the public half of `CameraModel` on row-by-row functions of a subclass."""

    @property
    @abstractmethod
    def title(self) -> str:
        """What people call this lens."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, float]:
        """Every parameter by name, in the order people write them."""

    @abstractmethod
    def _project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3)."""

    @abstractmethod
    def _unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2)."""

    @abstractmethod
    def _project_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `_project` by the point, rows (N, 6) of d(u, v) / d(x, y, z)."""

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points in camera axes (N, 3); NaN rows where the lens sees none."""
        return in_blocks(self._project, points, 2)

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2); NaN rows where no ray exists."""
        return in_blocks(self._unproject, pixels, 3)

    def project_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `project` by the point, shape (N, 2, 3); NaN where `project` is."""
        return in_blocks(self._project_jacobian, points, 6).reshape(-1, 2, 3)

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px; NaN where unseen.

        The inverse of `project_jacobian` on the plane perpendicular to each of the rays (N, 3),
        whose lengths do not matter.
        """
        rays = np.ascontiguousarray(rays, dtype=np.float64)
        jacobian = np.empty((len(rays), 3, 2))
        invert_projection(rays, self.project_jacobian(rays), jacobian)
        return jacobian
