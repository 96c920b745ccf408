"""Radial-tangential distortion of a plane, with OpenCV's coefficients, and its inverse.

The equations are those of OpenCV's calib3d documentation. The first four coefficients are from
Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32(3), 1966.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from farpoint.camera.curve import first_positive_root
from farpoint.camera.kernels.constants import LENS_TABLE_STEPS
from farpoint.camera.kernels.lens import distort, undistort
from farpoint.camera.plane_map import PlaneMap
from farpoint.camera.tilt import Tilt
from farpoint.camera.values import finite
from farpoint.errors import InputError

__all__ = [
    "COEFFICIENT_NAMES",
    "FEWEST_COEFFICIENTS",
    "RadialTangential",
    "coefficient_roles",
    "gather_coefficients",
]

COEFFICIENT_NAMES = (
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "tauX", "tauY"),
)
ALLOWED_COUNTS = (0, 4, 5, 8, 12, 14)

# Largest angle off the axis of the tables and of the search for the fold. A pinhole images this
# angle at a radius of 5700 focal lengths.
FARTHEST_RAD = np.deg2rad(89.99)
RADIAL_NODES = 1024
AZIMUTH_NODES = 181
# Largest radius in the evenly spaced part of the table of radii: tan(89 degrees) is 57.
FARTHEST_EVEN = 57.0
# Largest magnitude of a coefficient. Products of larger coefficients could overflow.
LARGEST = 1e12


# Number of coefficients (k1 k2 p1 p2) that a refinement adds to a pinhole without distortion.
FEWEST_COEFFICIENTS = 4


@dataclass(frozen=True)
class RadialTangential:
    """Distortion of the plane ``(x, y) -> (a, b)``, one-to-one within its `fold`.

    The map is used up to the `fold`: the smallest radius at which, for some azimuth, the
    determinant of the derivative of the map is zero. If the map is not purely radial, the fold is
    searched in steps of at most 0.09 degrees of the angle off the axis. Beyond the fold, the
    formula maps points into the image a second time, mirrored.

    Attributes
    ----------
    coefficients : tuple of float
        ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tauX tauY]]]]``; absent coefficients are zero.

    Raises
    ------
    InputError
        For another number of coefficients than 0, 4, 5, 8, 12 or 14, or for a coefficient that is
        not finite.
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", _checked(self.coefficients))

    @cached_property
    def is_identity(self) -> bool:
        """Whether all coefficients are zero, so that the map distorts nothing."""
        return not any(self.coefficients)

    def distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted plane coordinates; NaN where (x, y) lies beyond the fold."""
        seen = x * x + y * y < self.fold**2
        if not self.is_identity:
            x, y = self._map(x, y)[:2]
        a, b = np.where(seen, x, np.nan), np.where(seen, y, np.nan)
        return (a, b) if self._tilt is None else self._tilt.apply(a, b)

    def derivatives(self, x: np.ndarray, y: np.ndarray) -> PlaneMap:
        """Distorted coordinates and derivatives, without regard to the fold."""
        distorted = self._map(x, y)
        return distorted if self._tilt is None else self._tilt.chain(distorted)

    def coefficient_derivatives(
        self, x: np.ndarray, y: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Derivatives of `distort` by each of the `coefficients`, without regard to the fold."""
        straight = self._untilted_derivatives(x, y)[: len(self.coefficients)]
        if len(self.coefficients) < len(COEFFICIENT_NAMES):
            return straight
        tilt, inner = self._tilt or Tilt(0.0, 0.0), self._map(x, y)
        outer = tilt.derivatives(inner.a, inner.b)
        tilted = [
            (outer.a_x * a + outer.a_y * b, outer.b_x * a + outer.b_y * b) for a, b in straight
        ]
        return tilted + tilt.parameter_derivatives(inner.a, inner.b)

    def _untilted_derivatives(
        self, x: np.ndarray, y: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Derivatives of `_map` by the first five or, if the lens has more, twelve coefficients."""
        k1, k2, _, _, k3, k4, k5, k6 = self._full[:8]
        xx, yy, xy = x * x, y * y, x * y
        r2 = xx + yy
        r4 = r2 * r2
        r6 = r4 * r2
        inverse = 1.0 / (1.0 + k4 * r2 + k5 * r4 + k6 * r6)
        radial = [(x * power * inverse, y * power * inverse) for power in (r2, r4, r6)]
        tangential = [(2.0 * xy, r2 + 2.0 * yy), (r2 + 2.0 * xx, 2.0 * xy)]
        usual = [*radial[:2], *tangential, radial[2]]
        if len(self.coefficients) <= len(usual):
            return usual
        fall = -(1.0 + k1 * r2 + k2 * r4 + k3 * r6) * inverse * inverse
        zero = np.zeros_like(r2)
        rational = [(x * power * fall, y * power * fall) for power in (r2, r4, r6)]
        prism = [(r2, zero), (r4, zero), (zero, r2), (zero, r4)]
        return [*usual, *rational, *prism]

    def undistort(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse of `distort`; NaN for points (a, b) that are not the image of any point.

        Newton's method finds the inverse to 1e-10, and starts from a table of the inverse of the
        radial part.
        """
        if self._tilt is not None:
            a, b = self._tilt.invert(a, b)
        out = np.empty((2, len(a)))
        undistort(self.untilted, a, b, self._radial_table, self._farthest_image, self.fold, out)
        return out[0], out[1]

    @cached_property
    def untilted(self) -> np.ndarray:
        """The coefficients (12,) without the tilt; absent coefficients are zero."""
        return np.array(self._full[:12])

    @property
    def is_tilted(self) -> bool:
        """Whether the sensor is tilted relative to the lens."""
        return self._tilt is not None

    @cached_property
    def _full(self) -> tuple[float, ...]:
        return self.coefficients + (0.0,) * (len(COEFFICIENT_NAMES) - len(self.coefficients))

    @cached_property
    def _tilt(self) -> Tilt | None:
        tau_x, tau_y = self._full[12:]
        return Tilt(tau_x, tau_y) if tau_x or tau_y else None

    @cached_property
    def _is_radial(self) -> bool:
        return not any(self._full[2:4] + self._full[8:12])

    def _map(self, x: np.ndarray, y: np.ndarray) -> PlaneMap:
        """The distortion without tilt, and its derivatives."""
        out = np.empty((6, x.size))
        distort(self.untilted, x.ravel(), y.ravel(), out)
        return PlaneMap(*out.reshape(6, *x.shape))

    @cached_property
    def _farthest_image(self) -> float:
        """Largest radius in the distorted plane that the map reaches."""
        if np.isinf(self.fold):
            return np.inf
        azimuths = np.linspace(-np.pi, np.pi, AZIMUTH_NODES)
        rim = self._map(self.fold * np.cos(azimuths), self.fold * np.sin(azimuths))
        return float(np.hypot(rim.a, rim.b).max())

    @cached_property
    def _radial_table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Table of the radial part alone: distorted radii r, undistorted radii, and ratios.

        Both arrays of radii increase. The undistorted radii are tangents of evenly spaced angles.
        The ratios of undistorted to distorted radius are sampled in even steps of ``r / (1 + r)``.
        """
        before = np.tan(np.linspace(0.0, min(np.arctan(self.fold), FARTHEST_RAD), RADIAL_NODES))
        k1, k2, _, _, k3, k4, k5, k6 = self._full[:8]
        gain, _ = _even_polynomial(before * before, k1, k2, k3)
        loss, _ = _even_polynomial(before * before, k4, k5, k6)
        after = before * gain / loss
        farthest = min(after[-1], FARTHEST_EVEN)
        count = max(int(farthest / (1.0 + farthest) * LENS_TABLE_STEPS), 1)
        places = np.arange(1, count + 1)
        r = places / (LENS_TABLE_STEPS - places)
        return after, before, np.concatenate([[1.0], np.interp(r, after, before) / r])

    @cached_property
    def fold(self) -> float:
        """Largest undistorted radius of the map; infinite if the map is radial without a fold."""
        radial_fold = self._radial_fold
        if self._is_radial:
            return radial_fold
        farthest = min(np.arctan(radial_fold), FARTHEST_RAD)
        radii = np.tan(np.linspace(0.0, farthest, RADIAL_NODES))
        keeps = self._surely_keeps_orientation(radii)
        if not keeps.all():
            keeps[~keeps] = self._keeps_orientation(radii[~keeps])
        return float(radii[-1] if keeps.all() else radii[np.argmin(keeps) - 1])

    @cached_property
    def _radial_fold(self) -> float:
        """Radius at which the radial part alone stops increasing; infinite if the part always
        increases.
        """
        k1, k2, _, _, k3, k4, k5, k6 = self._full[:8]
        gain, loss = np.array([1.0, k1, k2, k3]), np.array([1.0, k4, k5, k6])
        degrees = np.arange(4)
        # Numerator of d(r gain / loss) / dr as a polynomial of r^2.
        slope = np.convolve((1.0 + 2.0 * degrees) * gain, loss)
        slope -= np.convolve(gain, 2.0 * degrees * loss)
        end = np.sqrt(min(first_positive_root(slope), first_positive_root(loss)))
        # Slightly below the root: at a root of `loss` the map is infinite. At a root of `slope` the
        # map is flat, so the factor does not change the distorted radius.
        return float(end * (1.0 - 1e-9))

    def _surely_keeps_orientation(self, radius: np.ndarray) -> np.ndarray:
        """Whether, at these radii, the non-radial terms are surely too small to cause a fold.

        The derivative of the map is ``A + E``, with A from the radial and E from the non-radial
        terms. ``A + E`` is regular if the least singular value of A exceeds the norm of E. The
        singular values of A are ``g`` (distorted over undistorted radius) and ``d(r g)/dr``. The
        norm of E is at most the sum of the absolute values of all derivatives in E.
        """
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._full[:12]
        r2 = radius * radius
        gain, gain_slope = _even_polynomial(r2, k1, k2, k3)
        loss, loss_slope = _even_polynomial(r2, k4, k5, k6)
        stretch = gain / loss
        along = stretch + 2.0 * r2 * (gain_slope - stretch * loss_slope) / loss
        tangential = 9.0 * radius * (abs(p1) + abs(p2))
        prism = 2.0 * radius * (abs(s1) + abs(s3) + 2.0 * r2 * (abs(s2) + abs(s4)))
        return np.minimum(stretch, along) > tangential + prism

    def _keeps_orientation(self, radius: np.ndarray) -> np.ndarray:
        """Whether the determinant is positive all along circles of these radii."""
        azimuths = np.linspace(-np.pi, np.pi, AZIMUTH_NODES)
        circles = np.multiply.outer(radius, np.array([np.cos(azimuths), np.sin(azimuths)]))
        return np.all(self._map(circles[..., 0, :], circles[..., 1, :]).determinant > 0.0, axis=-1)


def _even_polynomial(
    r2: np.ndarray, first: float, second: float, third: float
) -> tuple[np.ndarray, np.ndarray]:
    """``1 + first r^2 + second r^4 + third r^6`` and its derivative by ``r^2``."""
    value = 1.0 + r2 * (first + r2 * (second + r2 * third))
    return value, first + r2 * (2.0 * second + 3.0 * r2 * third)


def gather_coefficients(parameters: Mapping[str, float]) -> dict[str, Any]:
    """Parameters by name, but with all coefficients, in order, under the name ``distortion``."""
    fields: dict[str, Any] = {
        name: value for name, value in parameters.items() if name not in COEFFICIENT_NAMES
    }
    coefficients = (parameters[name] for name in COEFFICIENT_NAMES if name in parameters)
    return fields | {"distortion": tuple(coefficients)}


def coefficient_roles(count: int) -> dict[str, tuple[str, ...]]:
    """Names of the radial and of the decentering coefficients, for this number of coefficients."""
    names = COEFFICIENT_NAMES[:count]
    radial = tuple(name for name in names if name.startswith("k"))
    return {"radial": radial, "decentering": tuple(name for name in names if name not in radial)}


def _checked(coefficients: Sequence[float]) -> tuple[float, ...]:
    values = tuple(np.ravel(coefficients))
    if len(values) not in ALLOWED_COUNTS:
        raise InputError(
            f"expected 0, 4, 5, 8, 12 or 14 coefficients ({' '.join(COEFFICIENT_NAMES)}), "
            f"got {len(values)}",
            field="distortion",
        )
    checked = tuple(
        finite(f"distortion {name}", value)
        for name, value in zip(COEFFICIENT_NAMES, values, strict=False)
    )
    if any(abs(value) > LARGEST for value in checked):
        raise InputError(f"expected coefficients within +-{LARGEST:g}", field="distortion")
    return checked
