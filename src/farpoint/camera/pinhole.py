"""The pinhole with radial-tangential distortion: what OpenCV's `calibrateCamera` estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from farpoint.camera.focal import FocalModel, PlaneDerivatives, PlaneJacobian, rays_from_plane
from farpoint.camera.kernels.lens import pinhole_ray_jacobian, pinhole_rays, straight_ray_jacobian
from farpoint.camera.radtan import (
    COEFFICIENT_NAMES,
    FEWEST_COEFFICIENTS,
    RadialTangential,
    coefficient_roles,
    gather_coefficients,
)
from farpoint.camera.roles import ParameterRoles

__all__ = ["Pinhole"]


@dataclass(frozen=True, kw_only=True)
class Pinhole(FocalModel):
    """Pinhole camera with OpenCV's radial, tangential, thin-prism and tilt distortion.

    ``x = X/Z`` and ``y = Y/Z`` are distorted to (a, b) by `RadialTangential`. The pixel is ``u = fx
    a + cx`` and ``v = fy b + cy``. Points with ``Z <= 0``, and points beyond the radius up to which
    the distortion is one-to-one, are not visible.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    distortion : tuple of float
        ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tauX tauY]]]]``, empty for none.

    Raises
    ------
    InputError
        For a focal length that is not positive, a number that is not finite, or another count of
        coefficients than 0, 4, 5, 8, 12 or 14. The message names the field.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Pinhole(fx=500, fy=500, cx=320, cy=240, distortion=(-0.28, 0.07, 0, 0))
    >>> lens.project(np.array([[0.5, 0.0, 1.0]])).round(3)
    array([[553.594, 240.   ]])
    """

    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "distortion", RadialTangential(self.distortion).coefficients)

    @property
    def title(self) -> str:
        """Common name of this lens."""
        if not self.distortion:
            return "pinhole without distortion"
        return f"pinhole with radial-tangential distortion ({len(self.distortion)} coefficients)"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | dict(zip(COEFFICIENT_NAMES, self.distortion, strict=False))

    @property
    def roles(self) -> ParameterRoles:
        """Effects of the parameters on the image, from which priors of their errors are built."""
        return replace(super().roles, **coefficient_roles(len(self.distortion)))

    @classmethod
    def _fields_of(cls, parameters: Mapping[str, float]) -> dict[str, Any]:
        return gather_coefficients(parameters)

    def refinable(self) -> Pinhole:
        """The same lens. A lens without distortion gets the coefficients k1 k2 p1 p2, all zero."""
        if self.distortion:
            return self
        return replace(self, distortion=(0.0,) * FEWEST_COEFFICIENTS)

    @cached_property
    def _lens(self) -> RadialTangential:
        return RadialTangential(self.distortion)

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        depth = np.where(z > 0.0, z, np.nan)
        return self._lens.distort(x / depth, y / depth)

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        inverse = 1.0 / z
        x, y = x * inverse, y * inverse
        lens = self._lens.derivatives(x, y)
        return (
            (lens.a_x * inverse, lens.a_y * inverse, -(lens.a_x * x + lens.a_y * y) * inverse),
            (lens.b_x * inverse, lens.b_y * inverse, -(lens.b_x * x + lens.b_y * y) * inverse),
        )

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        return self._lens.coefficient_derivatives(x / z, y / z)

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return rays_from_plane(*self._lens.undistort(a, b), 1.0)

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2); NaN rows where no ray exists."""
        if not self._lens.is_identity:
            return super().unproject(pixels)
        pixels = np.ascontiguousarray(pixels, dtype=np.float64)
        rays = np.empty((len(pixels), 3))
        pinhole_rays(pixels, self.fx, self.fy, self.cx, self.cy, rays)
        return rays

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px; NaN for rays outside
        the field.
        """
        lens = self._lens
        if lens.is_tilted:
            return super().unproject_jacobian(rays)
        rays = np.ascontiguousarray(rays, dtype=np.float64)
        jacobian = np.empty((len(rays), 3, 2))
        if lens.is_identity:
            straight_ray_jacobian(self.fx, self.fy, rays, jacobian)
        else:
            pinhole_ray_jacobian(lens.untilted, lens.fold, self.fx, self.fy, rays, jacobian)
        return jacobian
