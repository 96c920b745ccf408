"""The common part of lenses with a focal length: conversion between plane and pixels."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from farpoint.camera.lens_model import LensModel
from farpoint.camera.roles import ParameterRoles
from farpoint.camera.values import finite, positive, within

__all__ = [
    "FocalModel",
    "PlaneDerivatives",
    "PlaneJacobian",
    "quotient_derivatives",
    "quotient_jacobian",
    "rays_from_plane",
]

FOCAL_RANGE_PX = 1e-3, 1e9
"""Range of focal lengths, px. Outside this range, angles of pixels are lost in rounding."""

PlaneJacobian = tuple[tuple[np.ndarray, ...], ...]
"""Rows of d(a, b) / d(x, y, z): two triples of arrays (N,)."""

PlaneDerivatives = list[tuple[np.ndarray, np.ndarray]]
"""Derivatives of (a, b) by several parameters: a pair of arrays (N,) for each parameter."""


@dataclass(frozen=True, kw_only=True)
class FocalModel(LensModel):
    """A lens that maps points to a plane (a, b), and then the plane to pixels.

    The pixels are ``u = fx * a + cx`` and ``v = fy * b + cy``. A subclass defines the map from
    points to the plane.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("fx", "fy"):
            focal_px = positive(name, getattr(self, name))
            object.__setattr__(self, name, within(name, focal_px, *FOCAL_RANGE_PX))
        for name in ("cx", "cy"):
            object.__setattr__(self, name, finite(name, getattr(self, name)))

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy}

    @property
    def roles(self) -> ParameterRoles:
        """Effects of the parameters on the image, from which priors of their errors are built.

        All parameters that only a subclass defines are taken as radial.
        """
        return ParameterRoles(
            scale={"fx": self.fx, "fy": self.fy},
            affine=({"fx": 0.5 * self.fx, "fy": -0.5 * self.fy},),
            center=("cx", "cy"),
            radial=tuple(self.parameters)[4:],
        )

    @abstractmethod
    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Plane coordinates of points; NaN for points that the lens does not see."""

    @abstractmethod
    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        """Derivative of `_to_plane` by the point; arbitrary where `_to_plane` is NaN."""

    @abstractmethod
    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        """Derivative of `_to_plane` by each parameter after the first four, in the usual order.

        The derivative is arbitrary where `_to_plane` is NaN.
        """

    @abstractmethod
    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of plane coordinates; NaN rows where no ray exists."""

    def linearised(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`project`, `project_jacobian` and `project_parameter_jacobian` of the same points."""
        x, y, z = np.asarray(points, dtype=np.float64).T
        with np.errstate(all="ignore"):
            a, b = self._to_plane(x, y, z)
            by_point = self._by_point(x, y, z, np.isnan(a)).reshape(-1, 2, 3)
            return self._pixels(a, b), by_point, self._by_parameters(x, y, z, a, b)

    def _project(self, points: np.ndarray) -> np.ndarray:
        return self._pixels(*self._to_plane(*points.T))

    def _pixels(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        pixels = np.empty((len(a), 2))
        pixels[:, 0] = self.fx * a + self.cx
        pixels[:, 1] = self.fy * b + self.cy
        return pixels

    def _unproject(self, pixels: np.ndarray) -> np.ndarray:
        return self._from_plane(
            (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy
        )

    def _project_jacobian(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        return self._by_point(x, y, z, np.isnan(self._to_plane(x, y, z)[0]))

    def _by_point(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray, unseen: np.ndarray
    ) -> np.ndarray:
        flat = np.empty((len(x), 6))
        for row, (focal, gradient) in enumerate(
            zip((self.fx, self.fy), self._to_plane_jacobian(x, y, z), strict=True)
        ):
            for column, derivative in enumerate(gradient):
                flat[:, 3 * row + column] = focal * derivative
        flat[unseen] = np.nan
        return flat

    def _project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        return self._by_parameters(x, y, z, *self._to_plane(x, y, z))

    def _by_parameters(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray, a: np.ndarray, b: np.ndarray
    ) -> np.ndarray:
        by_shape = self._to_plane_parameters(x, y, z)
        jacobian = np.zeros((len(x), 2, 4 + len(by_shape)))
        jacobian[:, 0, 0], jacobian[:, 1, 1] = a, b
        jacobian[:, 0, 2] = jacobian[:, 1, 3] = 1.0
        for column, (by_a, by_b) in enumerate(by_shape, start=4):
            jacobian[:, 0, column], jacobian[:, 1, column] = self.fx * by_a, self.fy * by_b
        jacobian[np.isnan(a)] = np.nan
        return jacobian


def quotient_jacobian(
    x: np.ndarray, y: np.ndarray, divisor: np.ndarray, gradient: tuple[np.ndarray, ...]
) -> PlaneJacobian:
    """Derivative of ``(x, y) / divisor`` by (x, y, z), from the gradient of the divisor."""
    inverse = 1.0 / divisor
    a, b = x * inverse, y * inverse
    by_x, by_y, by_z = gradient
    return (
        ((1.0 - a * by_x) * inverse, -a * by_y * inverse, -a * by_z * inverse),
        (-b * by_x * inverse, (1.0 - b * by_y) * inverse, -b * by_z * inverse),
    )


def quotient_derivatives(
    x: np.ndarray, y: np.ndarray, divisor: np.ndarray, steps: tuple[np.ndarray, ...]
) -> PlaneDerivatives:
    """Derivatives of ``(x, y) / divisor`` by parameters on which only the divisor depends.

    ``steps`` are the derivatives of the divisor by these parameters.
    """
    scales = [-step / divisor**2 for step in steps]
    return [(x * scale, y * scale) for scale in scales]


def rays_from_plane(x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> np.ndarray:
    """Unit vectors (N, 3) along (x, y, z); rows are NaN if (x, y, z) has no finite direction."""
    square = x * x + y * y + z * z
    scale = 1.0 / np.sqrt(square)
    if not np.max(square, initial=0.0) < np.inf:
        scale[~(square < np.inf)] = np.nan
    rays = np.empty((len(x), 3))
    rays[:, 0] = x * scale
    rays[:, 1] = y * scale
    rays[:, 2] = z * scale
    return rays
