"""Radial-tangential distortion of a plane, with OpenCV's coefficients, and its inverse.

The equations are those of OpenCV's calib3d documentation; the first four coefficients are Brown,
"Decentering distortion of lenses", Photogrammetric Engineering 32(3), 1966.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from farpoint.camera.curve import first_positive_root
from farpoint.camera.plane_map import PlaneMap
from farpoint.camera.tilt import Tilt
from farpoint.camera.values import finite
from farpoint.errors import InputError

__all__ = ["COEFFICIENT_NAMES", "RadialTangential"]

COEFFICIENT_NAMES = (
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "tauX", "tauY"),
)
ALLOWED_COUNTS = (0, 4, 5, 8, 12, 14)

# Beyond 89.99 degrees off the axis a pinhole's image is 5700 focal lengths away.
FARTHEST_RAD = np.deg2rad(89.99)
RADIAL_NODES = 1024
AZIMUTH_NODES = 181
NEWTON_TOLERANCE = 1e-10
NEWTON_ITERATIONS = 20
# No lens comes near; beyond it the products of coefficients would overflow.
LARGEST = 1e12


@dataclass(frozen=True)
class RadialTangential:
    """Distortion of the plane ``(x, y) -> (a, b)``, one-to-one within its `fold`.

    The map is used out to the smallest radius at which its determinant vanishes in any direction
    (found to a tenth of a per cent where the map is not purely radial). Beyond it the formula
    would put a second, mirrored image over the first.

    Attributes
    ----------
    coefficients : tuple of float
        ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tauX tauY]]]]``; absent ones are zero.

    Raises
    ------
    InputError
        For another number of coefficients than 0, 4, 5, 8, 12 or 14, or one that is not finite.
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", _checked(self.coefficients))

    @cached_property
    def is_identity(self) -> bool:
        """Whether nothing is distorted."""
        return not any(self.coefficients)

    def distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted plane coordinates; NaN where (x, y) lies beyond the fold."""
        distorted = self._map(x, y)
        seen = x * x + y * y < self.fold**2
        a, b = np.where(seen, distorted.a, np.nan), np.where(seen, distorted.b, np.nan)
        return (a, b) if self._tilt is None else self._tilt.apply(a, b)

    def derivatives(self, x: np.ndarray, y: np.ndarray) -> PlaneMap:
        """Distorted coordinates and derivatives, without regard to the fold."""
        distorted = self._map(x, y)
        return distorted if self._tilt is None else self._tilt.chain(distorted)

    def undistort(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse of `distort`; NaN where nothing is imaged.

        Newton's method to 1e-10, started from the tabulated inverse of the radial part.
        """
        if self._tilt is not None:
            a, b = self._tilt.invert(a, b)
        x, y = self._start(a, b)
        active = np.arange(len(x))
        for _ in range(NEWTON_ITERATIONS):
            here = self._map(x[active], y[active])
            step_x, step_y = here.newton_step(a[active], b[active])
            x[active] += step_x
            y[active] += step_y
            moved = np.abs(step_x) + np.abs(step_y)
            # NaN counts as settled: it stays NaN.
            active = active[
                moved > NEWTON_TOLERANCE * (1.0 + np.abs(x[active]) + np.abs(y[active]))
            ]
            if not active.size:
                break
        x[active] = np.nan
        outside = ~(x * x + y * y < self.fold**2)
        x[outside] = y[outside] = np.nan
        return x, y

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

    def _radial(self, r2: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Magnification and its derivative by the squared radius."""
        k1, k2, _, _, k3, k4, k5, k6 = self._full[:8]
        gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        gain_slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
        if not (k4 or k5 or k6):
            return gain, gain_slope
        loss = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        loss_slope = k4 + r2 * (2.0 * k5 + r2 * (3.0 * k6))
        ratio = gain / loss
        return ratio, (gain_slope - ratio * loss_slope) / loss

    def _map(self, x: np.ndarray, y: np.ndarray) -> PlaneMap:
        """The distortion without tilt, and its derivatives."""
        p1, p2 = self._full[2:4]
        s1, s2, s3, s4 = self._full[8:12]
        xx, yy, xy = x * x, y * y, x * y
        r2 = xx + yy
        gain, slope = self._radial(r2)
        a, b = x * gain, y * gain
        a_x, b_y = gain + 2.0 * xx * slope, gain + 2.0 * yy * slope
        a_y = b_x = 2.0 * xy * slope
        if p1 or p2:
            a = a + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx)
            b = b + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy
            a_x = a_x + 2.0 * p1 * y + 6.0 * p2 * x
            b_y = b_y + 6.0 * p1 * y + 2.0 * p2 * x
            a_y = b_x = a_y + 2.0 * p1 * x + 2.0 * p2 * y
        if s1 or s2 or s3 or s4:
            a, b = a + r2 * (s1 + s2 * r2), b + r2 * (s3 + s4 * r2)
            prism_a, prism_b = 2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)
            a_x, a_y = a_x + x * prism_a, a_y + y * prism_a
            b_x, b_y = b_x + x * prism_b, b_y + y * prism_b
        return PlaneMap(a, b, a_x, a_y, b_x, b_y)

    def _start(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        radius, distorted = self._radial_table
        target = np.hypot(a, b)
        scale = np.interp(target, distorted, radius) / target
        scale[target == 0.0] = 1.0
        # Newton would search in vain for what no point is imaged to.
        scale[target > self._farthest_image] = np.nan
        return a * scale, b * scale

    @cached_property
    def _farthest_image(self) -> float:
        """Largest radius of the distorted plane that is reached."""
        if np.isinf(self.fold):
            return np.inf
        azimuths = np.linspace(-np.pi, np.pi, AZIMUTH_NODES)
        rim = self._map(self.fold * np.cos(azimuths), self.fold * np.sin(azimuths))
        return float(np.hypot(rim.a, rim.b).max())

    @cached_property
    def _radial_table(self) -> tuple[np.ndarray, np.ndarray]:
        """Radii before and after the radial part alone, increasing, evenly spaced in angle."""
        radius = np.tan(np.linspace(0.0, min(np.arctan(self.fold), FARTHEST_RAD), RADIAL_NODES))
        return radius, radius * self._radial(radius * radius)[0]

    @cached_property
    def fold(self) -> float:
        """Radius of the undistorted plane up to which the map is used; infinite if all of it."""
        radial_fold = self._radial_fold
        if self._is_radial:
            return radial_fold
        farthest = min(np.arctan(radial_fold), FARTHEST_RAD)
        radii = np.tan(np.linspace(0.0, farthest, RADIAL_NODES))
        keeps = self._keeps_orientation(radii)
        return float(radii[-1] if keeps.all() else radii[np.argmin(keeps) - 1])

    @cached_property
    def _radial_fold(self) -> float:
        """Radius at which the radial part alone stops growing; infinite if it never does."""
        k1, k2, _, _, k3, k4, k5, k6 = self._full[:8]
        gain, loss = Polynomial([1, k1, k2, k3]), Polynomial([1, k4, k5, k6])
        # Numerator of d(r gain / loss) / dr as a polynomial of r^2.
        growth = gain * loss + Polynomial([0, 2]) * (gain.deriv() * loss - gain * loss.deriv())
        end = np.sqrt(min(first_positive_root(growth.coef), first_positive_root(loss.coef)))
        # Short of a pole, where the denominator vanishes; at a fold the height does not change.
        return float(end * (1.0 - 1e-9))

    def _keeps_orientation(self, radius: np.ndarray) -> np.ndarray:
        """Whether the determinant is positive all along circles of these radii."""
        azimuths = np.linspace(-np.pi, np.pi, AZIMUTH_NODES)
        circles = np.multiply.outer(radius, np.array([np.cos(azimuths), np.sin(azimuths)]))
        return np.all(self._map(circles[..., 0, :], circles[..., 1, :]).determinant > 0.0, axis=-1)


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
