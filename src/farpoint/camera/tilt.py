"""A sensor that is not parallel to the lens (Scheimpflug): OpenCV's tauX and tauY."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.plane_map import PlaneMap

__all__ = ["Tilt"]

# Derivatives of `_about_x` and `_about_y` at angle 0. A generator commutes with its rotations.
GENERATOR_X = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
GENERATOR_Y = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Tilt:
    """Central projection of the plane onto a plane rotated about the x axis and then about the y
    axis.

    The equations are in OpenCV's calib3d documentation, after Louhichi et al., "Self-calibration of
    Scheimpflug cameras: an easy protocol", Measurement Science and Technology 18, 2616, 2007.

    Attributes
    ----------
    tau_x, tau_y : float
        Rotation angles of the sensor about x and y, rad.
    """

    tau_x: float
    tau_y: float

    @cached_property
    def homography(self) -> np.ndarray:
        """Homography (3, 3) from plane coordinates without the tilt to tilted plane coordinates."""
        turn = _about_y(self.tau_y) @ _about_x(self.tau_x)
        return _onto_sensor(turn, 1.0) @ turn

    @cached_property
    def homography_derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the homography by `tau_x` and by `tau_y`, (3, 3) each."""
        about_x, about_y = _about_x(self.tau_x), _about_y(self.tau_y)
        turn = about_y @ about_x
        steps = about_y @ GENERATOR_X @ about_x, about_y @ GENERATOR_Y @ about_x
        onto_sensor = _onto_sensor(turn, 1.0)
        by_x, by_y = (_onto_sensor(step, 0.0) @ turn + onto_sensor @ step for step in steps)
        return by_x, by_y

    def apply(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tilted coordinates; NaN for rays that do not meet the sensor."""
        return _project(self.homography, x, y)

    def invert(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates before the tilt, from tilted coordinates; NaN beyond the sensor's horizon."""
        return _project(np.linalg.inv(self.homography), a, b)

    def chain(self, inner: PlaneMap) -> PlaneMap:
        """The map followed by the tilt."""
        tilt = self.derivatives(inner.a, inner.b)
        return PlaneMap(
            tilt.a,
            tilt.b,
            tilt.a_x * inner.a_x + tilt.a_y * inner.b_x,
            tilt.a_x * inner.a_y + tilt.a_y * inner.b_y,
            tilt.b_x * inner.a_x + tilt.b_y * inner.b_x,
            tilt.b_x * inner.a_y + tilt.b_y * inner.b_y,
        )

    def derivatives(self, x: np.ndarray, y: np.ndarray) -> PlaneMap:
        """Tilted coordinates, and their derivatives by the coordinates without the tilt."""
        H = self.homography
        a, b = _project(H, x, y)
        depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        a_x, a_y = (H[0, 0] - a * H[2, 0]) / depth, (H[0, 1] - a * H[2, 1]) / depth
        b_x, b_y = (H[1, 0] - b * H[2, 0]) / depth, (H[1, 1] - b * H[2, 1]) / depth
        return PlaneMap(a, b, a_x, a_y, b_x, b_y)

    def parameter_derivatives(
        self, x: np.ndarray, y: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Derivatives of `apply` at (x, y) by `tau_x` and by `tau_y`."""
        H = self.homography
        a, b = _project(H, x, y)
        depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        derivatives = []
        for by_tau in self.homography_derivatives:
            over_a, over_b, under = (row[0] * x + row[1] * y + row[2] for row in by_tau)
            derivatives.append(((over_a - a * under) / depth, (over_b - b * under) / depth))
        return derivatives


def _about_x(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def _about_y(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def _onto_sensor(turn: np.ndarray, last: float) -> np.ndarray:
    """Projection (3, 3) onto the plane rotated by `turn`, or the derivative of this projection.

    ``last`` is the last element of the matrix: 1 for the projection, 0 for the derivative.
    """
    return np.array(
        [[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, last]]
    )


def _project(H: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    depth = np.where(depth > 0.0, depth, np.nan)
    return (
        (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / depth,
        (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / depth,
    )
