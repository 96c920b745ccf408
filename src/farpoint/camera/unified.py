"""The unified model of Geyer, Barreto and Mei: a sphere, projected from a point off its centre."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from farpoint.camera.focal import (
    FocalModel,
    PlaneDerivatives,
    PlaneJacobian,
    quotient_jacobian,
)
from farpoint.camera.radtan import (
    COEFFICIENT_NAMES,
    RadialTangential,
    coefficient_roles,
    gather_coefficients,
)
from farpoint.camera.roles import ParameterRoles
from farpoint.camera.values import finite, within

__all__ = ["Unified"]


@dataclass(frozen=True, kw_only=True)
class Unified(FocalModel):
    """Lens or mirror with ``(x, y) = (X, Y) / (Z + xi |(X, Y, Z)|)``, followed by a distortion.

    ``(a, b)`` is (x, y) distorted by `RadialTangential`. The pixel is ``u = fx a + skew b + cx``
    and ``v = fy b + cy``. OpenCV calls this lens ``omnidir``, Kalibr ``omni`` and CamOdoCal MEI.
    ``xi = 1`` is a parabolic mirror, ``xi = 0`` a pinhole.

    The model is from Mei and Rives, "Single view point omnidirectional camera calibration from
    planar grids", ICRA 2007, doi:10.1109/ROBOT.2007.364084.

    Attributes
    ----------
    fx, fy : float
        Generalised focal lengths of the paper, px, which are about ``1 + xi`` times the focal
        lengths that a pinhole would have.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    xi : float
        Distance of the pinhole from the sphere's centre, sphere radii, from 0 to 100.
    distortion : tuple of float
        ``k1 k2 p1 p2 [k3 ...]``, empty for none.
    skew : float
        Horizontal shift of a pixel for a unit of ``b``, px.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Unified(fx=400, fy=400, cx=320, cy=240, xi=1)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]]))
    array([[720., 240.]])
    """

    xi: float
    distortion: tuple[float, ...] = ()
    skew: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        # Visible points have Z / |(X, Y, Z)| > -1 / xi. For xi = 100 this is nearly Z > 0, and a
        # larger xi hardly changes the lens.
        object.__setattr__(self, "xi", within("xi", self.xi, 0.0, 100.0))
        object.__setattr__(self, "distortion", RadialTangential(self.distortion).coefficients)
        object.__setattr__(self, "skew", finite("skew", self.skew))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        count = len(self.distortion)
        distorted = f"radial-tangential distortion ({count} coefficients)" if count else ""
        return f"unified (Mei) with{f' {distorted}' if count else 'out distortion'}"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        named = {"xi": self.xi} | dict(zip(COEFFICIENT_NAMES, self.distortion, strict=False))
        return super().parameters | named | {"skew": self.skew}

    @property
    def roles(self) -> ParameterRoles:
        """Effects of the parameters on the image, from which priors of their errors are built."""
        inner, coefficients = super().roles, coefficient_roles(len(self.distortion))
        return replace(
            inner,
            scale=inner.scale | {"skew": self.skew},
            affine=(*inner.affine, {"skew": self.fx}),
            radial=("xi", *coefficients["radial"]),
            decentering=coefficients["decentering"],
        )

    @classmethod
    def _fields_of(cls, parameters: Mapping[str, float]) -> dict[str, Any]:
        return gather_coefficients(parameters)

    @cached_property
    def _lens(self) -> RadialTangential:
        return RadialTangential(self.distortion)

    @cached_property
    def _shear(self) -> float:
        return self.skew / self.fx

    @cached_property
    def _lowest_cosine(self) -> float:
        """Bound that ``Z / |(X, Y, Z)|`` must exceed for a visible point.

        At this cosine the divisor vanishes if xi is at most 1. For larger xi, ``sin / (xi + cos)``
        stops increasing at this cosine.
        """
        return -min(self.xi, 1.0 / self.xi) if self.xi > 0.0 else 0.0

    def _on_normal_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The length of the points, and their images before distortion."""
        d = np.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / (z + self.xi * d)
        return d, x * inverse, y * inverse

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        d, x, y = self._on_normal_plane(x, y, z)
        a, b = self._lens.distort(np.where(z > self._lowest_cosine * d, x, np.nan), y)
        return a + self._shear * b, b

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        d, plane_x, plane_y = self._on_normal_plane(x, y, z)
        pull = self.xi / d
        gradients = quotient_jacobian(x, y, z + self.xi * d, (pull * x, pull * y, pull * z + 1.0))
        lens = self._lens.derivatives(plane_x, plane_y)
        a_x, a_y = lens.a_x + self._shear * lens.b_x, lens.a_y + self._shear * lens.b_y
        return tuple(
            tuple(along_x * by_x + along_y * by_y for by_x, by_y in zip(*gradients, strict=True))
            for along_x, along_y in ((a_x, a_y), (lens.b_x, lens.b_y))
        )

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        d, plane_x, plane_y = self._on_normal_plane(x, y, z)
        pull = -d / (z + self.xi * d)
        lens = self._lens.derivatives(plane_x, plane_y)
        x, y = plane_x * pull, plane_y * pull
        by_xi = lens.a_x * x + lens.a_y * y, lens.b_x * x + lens.b_y * y
        by_coefficients = self._lens.coefficient_derivatives(plane_x, plane_y)
        sheared = [(by_a + self._shear * by_b, by_b) for by_a, by_b in (by_xi, *by_coefficients)]
        return [*sheared, (lens.b / self.fx, np.zeros_like(lens.b))]

    def _by_parameters(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray, a: np.ndarray, b: np.ndarray
    ) -> np.ndarray:
        jacobian = super()._by_parameters(x, y, z, a, b)
        # The term skew b of u does not depend on fx.
        jacobian[:, 0, 0] -= self._shear * jacobian[:, 1, 1]
        return jacobian

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        x, y = a - self._shear * b, b
        if not self._lens.is_identity:
            x, y = self._lens.undistort(x, y)
        square = x * x + y * y
        # The root is NaN outside the circle that contains the image.
        scale = (self.xi + np.sqrt(1.0 + (1.0 - self.xi**2) * square)) / (1.0 + square)
        rays = np.empty((len(a), 3))
        rays[:, 0] = scale * x
        rays[:, 1] = scale * y
        rays[:, 2] = scale - self.xi
        rays[~(square < np.inf)] = np.nan
        return rays
