"""The double sphere model: projection onto two spheres in turn, then a pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.extended_unified import lowest_cosine
from farpoint.camera.focal import (
    FocalModel,
    PlaneDerivatives,
    PlaneJacobian,
    quotient_derivatives,
    quotient_jacobian,
    rays_from_plane,
)
from farpoint.camera.values import within

__all__ = ["DoubleSphere"]


@dataclass(frozen=True, kw_only=True)
class DoubleSphere(FocalModel):
    """Lens with ``(a, b) = (X, Y) / (alpha d2 + (1 - alpha) h)``, ``h = xi d1 + Z``.

    ``d1`` is the length of (X, Y, Z), and ``d2`` is the length of (X, Y, h).

    The model is from Usenko, Demmel and Cremers, "The double sphere camera model", 3DV 2018,
    doi:10.1109/3DV.2018.00069.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    xi : float
        Distance of the spheres' centres, sphere radii, from -1 to 1.
    alpha : float
        Coefficient from 0 to 1; 0 gives the unified model.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = DoubleSphere(fx=200, fy=200, cx=320, cy=240, xi=0, alpha=0.5)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]]))
    array([[720., 240.]])
    """

    xi: float
    alpha: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "xi", within("xi", self.xi, -1.0, 1.0))
        object.__setattr__(self, "alpha", within("alpha", self.alpha, 0.0, 1.0))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return "double sphere"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | {"xi": self.xi, "alpha": self.alpha}

    @cached_property
    def _lowest_cosine(self) -> float:
        """Lower bound of ``h / d2``, where the image point is at infinity or the map folds.

        The paper gives a bound on ``Z / d1`` (equation 43), which is not exact: with alpha = 1 the
        fold is at ``Z = -xi d1``, not at ``-xi d1 / sqrt(1 + xi^2)``.
        """
        return lowest_cosine(self.alpha)

    def _lengths(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``d1``, the depth ``h`` seen from the second centre, and ``d2``."""
        square = x * x + y * y
        d1 = np.sqrt(square + z * z)
        h = self.xi * d1 + z
        return d1, h, np.sqrt(square + h * h)

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        _, h, d2 = self._lengths(x, y, z)
        divisor = self.alpha * d2 + (1.0 - self.alpha) * h
        divisor = np.where(h > self._lowest_cosine * d2, divisor, np.nan)
        return x / divisor, y / divisor

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        d1, h, d2 = self._lengths(x, y, z)
        h_x, h_y, h_z = self.xi * x / d1, self.xi * y / d1, self.xi * z / d1 + 1.0
        pull, rest = self.alpha / d2, 1.0 - self.alpha
        gradient = (
            pull * (x + h * h_x) + rest * h_x,
            pull * (y + h * h_y) + rest * h_y,
            pull * h * h_z + rest * h_z,
        )
        return quotient_jacobian(x, y, self.alpha * d2 + rest * h, gradient)

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        d1, h, d2 = self._lengths(x, y, z)
        divisor = self.alpha * d2 + (1.0 - self.alpha) * h
        by_xi = d1 * (self.alpha * h / d2 + (1.0 - self.alpha))
        return quotient_derivatives(x, y, divisor, (by_xi, d2 - h))

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        square = a * a + b * b
        # The root is NaN outside the circle that contains the image.
        root = np.sqrt(1.0 - (2.0 * self.alpha - 1.0) * square)
        h = (1.0 - self.alpha**2 * square) / (self.alpha * root + (1.0 - self.alpha))
        h2 = h * h
        scale = (h * self.xi + np.sqrt(h2 + (1.0 - self.xi**2) * square)) / (h2 + square)
        return rays_from_plane(scale * a, scale * b, scale * h - self.xi)
