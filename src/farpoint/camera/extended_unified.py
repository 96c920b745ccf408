"""The extended unified camera model (EUCM): projection onto an ellipsoid, then a pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.focal import (
    FocalModel,
    PlaneDerivatives,
    PlaneJacobian,
    quotient_derivatives,
    quotient_jacobian,
    rays_from_plane,
)
from farpoint.camera.values import positive, within

__all__ = ["ExtendedUnified", "lowest_cosine"]


@dataclass(frozen=True, kw_only=True)
class ExtendedUnified(FocalModel):
    """Lens with ``(a, b) = (X, Y) / (alpha d + (1 - alpha) Z)``, ``d^2 = beta (X^2 + Y^2) + Z^2``.

    The model is from Khomutenko, Garcia and Martinet, "An enhanced unified camera model", RA-L
    1(1), 2016, doi:10.1109/LRA.2015.2502921. The region in which the model is one-to-one is from
    Usenko, Demmel and Cremers, "The double sphere camera model", 3DV 2018,
    doi:10.1109/3DV.2018.00069.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, px.
    cx, cy : float
        Principal point, px; the centre of the top-left pixel is (0, 0).
    alpha : float
        Coefficient from 0 to 1; 0 gives a pinhole.
    beta : float
        Positive coefficient; 1 gives the unified model of Geyer and Mei.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = ExtendedUnified(fx=200, fy=200, cx=320, cy=240, alpha=0.5, beta=1)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]]))
    array([[720., 240.]])
    """

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "alpha", within("alpha", self.alpha, 0.0, 1.0))
        object.__setattr__(self, "beta", positive("beta", self.beta))

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return "extended unified camera model (EUCM)"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        return super().parameters | {"alpha": self.alpha, "beta": self.beta}

    @cached_property
    def _lowest_cosine(self) -> float:
        """Bound that ``Z / d`` must exceed for a visible point."""
        return lowest_cosine(self.alpha)

    def _to_plane(
        self, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        d = np.sqrt(self.beta * (x * x + y * y) + z * z)
        divisor = self.alpha * d + (1.0 - self.alpha) * z
        divisor = np.where(z > self._lowest_cosine * d, divisor, np.nan)
        return x / divisor, y / divisor

    def _to_plane_jacobian(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneJacobian:
        d = np.sqrt(self.beta * (x * x + y * y) + z * z)
        pull = self.alpha / d
        gradient = (pull * self.beta * x, pull * self.beta * y, pull * z + (1.0 - self.alpha))
        return quotient_jacobian(x, y, self.alpha * d + (1.0 - self.alpha) * z, gradient)

    def _to_plane_parameters(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> PlaneDerivatives:
        square = x * x + y * y
        d = np.sqrt(self.beta * square + z * z)
        divisor = self.alpha * d + (1.0 - self.alpha) * z
        return quotient_derivatives(x, y, divisor, (d - z, 0.5 * self.alpha * square / d))

    def _from_plane(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        square = self.beta * (a * a + b * b)
        # The root is NaN outside the circle that contains the image.
        root = np.sqrt(1.0 - (2.0 * self.alpha - 1.0) * square)
        depth = (1.0 - self.alpha**2 * square) / (self.alpha * root + (1.0 - self.alpha))
        return rays_from_plane(a, b, depth)


def lowest_cosine(alpha: float) -> float:
    """Cosine on the sphere down to which ``sin / (alpha + (1 - alpha) cos)`` increases.

    At this cosine the divisor vanishes if alpha is at most 1/2. For larger alpha the slope vanishes
    at this cosine.
    """
    return -alpha / (1.0 - alpha) if alpha <= 0.5 else -(1.0 - alpha) / alpha
