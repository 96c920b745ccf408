"""Scaramuzza's polynomial model, as the OCamCalib toolbox calibrates it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from farpoint.camera.curve import MonotonicCurve, first_positive_root
from farpoint.camera.focal import rays_from_plane
from farpoint.camera.lens_model import LensModel
from farpoint.camera.roles import ParameterRoles
from farpoint.camera.values import finite
from farpoint.errors import InputError

__all__ = ["Scaramuzza"]

# Largest radius, focal lengths, of a curve that never stops increasing. A pinhole has an angle of
# 88.9 degrees at this radius.
FARTHEST = 50.0


@dataclass(frozen=True, kw_only=True)
class Scaramuzza(LensModel):
    """Lens or mirror for which the ray of a sensor point (p, q) has the direction ``(p, q,
    -f(rho))``.

    ``f(rho) = a0 + a1 rho + a2 rho^2 + ...`` with ``rho = sqrt(p^2 + q^2)`` px, and ``u = p + e q +
    cx``, ``v = d p + c q + cy``. The toolbox's axes are x down, y right and z backward. farpoint's
    axes are x right, y down and z forward. Points are visible up to the radius at which the angle
    off the axis stops increasing. Projection inverts f itself. The inverse polynomial of the
    toolbox is only a fit and is not used.

    The model is from Scaramuzza, Martinelli and Siegwart, "A toolbox for easily calibrating
    omnidirectional cameras", IROS 2006, doi:10.1109/IROS.2006.282372.

    Attributes
    ----------
    coefficients : tuple of float
        ``a0 a1 a2 ...``, ``a0`` negative, px.
    cx, cy : float
        Centre of distortion, px, which is the column and the row in the toolbox. The centre of the
        top-left pixel is (0, 0).
    c, d, e : float
        Affine distortion of the sensor, with ``c > d e``.

    Raises
    ------
    InputError
        For a parameter out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> lens = Scaramuzza(coefficients=(-200, 0, 0.00125), cx=320, cy=240)
    >>> lens.project(np.array([[1.0, 0.0, 0.0]])).round(6)
    array([[720., 240.]])
    """

    coefficients: tuple[float, ...]
    cx: float
    cy: float
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", _checked(self.coefficients))
        for name in ("cx", "cy", "c", "d", "e"):
            object.__setattr__(self, name, finite(name, getattr(self, name)))
        if not self.c - self.d * self.e > 0.0:
            raise InputError(
                f"expected c greater than d e, got {self.c:g} and {self.d * self.e:g}", field="c"
            )

    @property
    def title(self) -> str:
        """Common name of this lens."""
        return f"Scaramuzza polynomial (OCamCalib) of {len(self.coefficients)} coefficients"

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        named = {f"a{power}": value for power, value in enumerate(self.coefficients)}
        return named | {"cx": self.cx, "cy": self.cy, "c": self.c, "d": self.d, "e": self.e}

    @property
    def roles(self) -> ParameterRoles:
        """Effects of the parameters on the image, from which priors of their errors are built.

        A rotation of the sensor, ``d = -e``, equals a rotation of the camera and is no error of the
        lens. A zero ``a1`` is exact: the toolbox fixes ``a1`` at zero, because any other ``a1``
        gives f a kink at the axis.
        """
        coefficients = [(f"a{power}", a) for power, a in enumerate(self.coefficients)]
        return ParameterRoles(
            scale={name: (1 - power) * a for power, (name, a) in enumerate(coefficients)},
            affine=({"c": -self.c}, {"e": 1.0}),
            center=("cx", "cy"),
            radial=tuple(name for name, a in coefficients[1:] if name != "a1" or a),
        )

    @classmethod
    def _fields_of(cls, parameters: Mapping[str, float]) -> dict[str, Any]:
        named, coefficients = dict(parameters), []
        while (name := f"a{len(coefficients)}") in named:
            coefficients.append(named.pop(name))
        return {"coefficients": tuple(coefficients)} | named

    @cached_property
    def _focal(self) -> float:
        return -self.coefficients[0]

    @cached_property
    def _depth(self) -> Polynomial:
        """``-f`` as a function of the radius, both in focal lengths. The constant term is 1."""
        powers = np.arange(len(self.coefficients))
        return Polynomial(-np.array(self.coefficients) * self._focal ** (powers - 1.0))

    @cached_property
    def _depth_slope(self) -> Polynomial:
        return self._depth.deriv()

    @cached_property
    def _curve(self) -> MonotonicCurve:
        """The angle off the axis, rad, as a function of the radius in focal lengths."""
        slope = self._depth - Polynomial([0.0, 1.0]) * self._depth_slope
        return MonotonicCurve(self._angle, min(first_positive_root(slope.coef), FARTHEST))

    def _angle(self, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        depth, slope = self._depth(radius), self._depth_slope(radius)
        return np.arctan2(radius, depth), (depth - radius * slope) / (radius**2 + depth**2)

    def _project(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        off_axis = np.sqrt(x * x + y * y)
        radius = self._curve.invert(np.arctan2(off_axis, z))
        scale = self._focal * np.where(off_axis == 0.0, 1.0 / z, radius / off_axis)
        scale[np.isnan(radius)] = np.nan
        p, q = x * scale, y * scale
        return np.column_stack([p + self.e * q + self.cx, self.d * p + self.c * q + self.cy])

    def _unproject(self, pixels: np.ndarray) -> np.ndarray:
        u, v = pixels[:, 0] - self.cx, pixels[:, 1] - self.cy
        inverse = 1.0 / (self._focal * (self.c - self.d * self.e))
        p, q = (self.c * u - self.e * v) * inverse, (v - self.d * u) * inverse
        radius = np.sqrt(p * p + q * q)
        radius = np.where(radius < self._curve.end, radius, np.nan)
        return rays_from_plane(p, q, self._depth(radius))

    def _project_jacobian(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        square = x * x + y * y
        off_axis, distance2 = np.sqrt(square), square + z * z
        radius = self._curve.invert(np.arctan2(off_axis, z))
        by_angle = 1.0 / self._angle(radius)[1]
        scale = np.where(off_axis > 0.0, radius / off_axis, 1.0 / z)
        curvature = np.where(off_axis > 0.0, (by_angle * z / distance2 - scale) / square, 0.0)
        cross, fall = x * y * curvature, -by_angle / distance2
        p = np.column_stack([scale + x * x * curvature, cross, x * fall])
        q = np.column_stack([cross, scale + y * y * curvature, y * fall])
        flat = self._focal * np.hstack([p + self.e * q, self.d * p + self.c * q])
        # The point (0, 0, 0) has no pixel, but `arctan2` gives it an angle.
        flat[np.isnan(flat).any(axis=1)] = np.nan
        return flat

    def _project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        off_axis = np.sqrt(x * x + y * y)
        radius = self._curve.invert(np.arctan2(off_axis, z))
        # The radius rho px solves rho z + f(rho) R = 0 with R = off_axis.
        inverse = 1.0 / (z - off_axis * self._depth_slope(radius))
        scale = self._focal * np.where(off_axis == 0.0, inverse, radius / off_axis)
        count = len(self.coefficients)
        jacobian = np.zeros((len(points), 2, count + 5))
        for power in range(count):
            by_scale = -((self._focal * radius) ** power) * inverse
            p, q = x * by_scale, y * by_scale
            jacobian[:, 0, power], jacobian[:, 1, power] = p + self.e * q, self.d * p + self.c * q
        p, q = x * scale, y * scale
        jacobian[:, 0, count] = jacobian[:, 1, count + 1] = 1.0
        jacobian[:, 1, count + 2], jacobian[:, 1, count + 3], jacobian[:, 0, count + 4] = q, p, q
        jacobian[np.isnan(p)] = np.nan
        return jacobian


def _checked(coefficients: Sequence[float]) -> tuple[float, ...]:
    values = tuple(finite(f"a{power}", value) for power, value in enumerate(coefficients))
    if not values or values[0] >= 0.0:
        raise InputError(
            f"expected a negative number, got {values[0] if values else 'none'}", field="a0"
        )
    return values
