"""A sensor that is not parallel to the lens (Scheimpflug): OpenCV's tauX and tauY."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint.camera.plane_map import PlaneMap

__all__ = ["Tilt"]


@dataclass(frozen=True)
class Tilt:
    """Central projection of the plane onto one turned about the x and then the y axis.

    The equations stand in OpenCV's calib3d documentation, after Louhichi et al.,
    "Self-calibration of Scheimpflug cameras: an easy protocol", Measurement Science and
    Technology 18, 2616, 2007.

    Attributes
    ----------
    tau_x, tau_y : float
        Turns of the sensor, rad.
    """

    tau_x: float
    tau_y: float

    @cached_property
    def homography(self) -> np.ndarray:
        """Tilted from straight plane coordinates, (3, 3)."""
        cos_x, sin_x = np.cos(self.tau_x), np.sin(self.tau_x)
        cos_y, sin_y = np.cos(self.tau_y), np.sin(self.tau_y)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, sin_x], [0.0, -sin_x, cos_x]])
        about_y = np.array([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
        turn = about_y @ about_x
        onto_sensor = np.array(
            [[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]]
        )
        return onto_sensor @ turn

    def apply(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tilted coordinates; NaN where a ray runs away from the sensor."""
        return _project(self.homography, x, y)

    def invert(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Straight coordinates of tilted ones; NaN beyond the horizon of the sensor."""
        return _project(np.linalg.inv(self.homography), a, b)

    def chain(self, inner: PlaneMap) -> PlaneMap:
        """The map followed by the tilt."""
        H = self.homography
        a, b = _project(H, inner.a, inner.b)
        depth = H[2, 0] * inner.a + H[2, 1] * inner.b + H[2, 2]
        a_a, a_b = (H[0, 0] - a * H[2, 0]) / depth, (H[0, 1] - a * H[2, 1]) / depth
        b_a, b_b = (H[1, 0] - b * H[2, 0]) / depth, (H[1, 1] - b * H[2, 1]) / depth
        return PlaneMap(
            a,
            b,
            a_a * inner.a_x + a_b * inner.b_x,
            a_a * inner.a_y + a_b * inner.b_y,
            b_a * inner.a_x + b_b * inner.b_x,
            b_a * inner.a_y + b_b * inner.b_y,
        )


def _project(H: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    depth = np.where(depth > 0.0, depth, np.nan)
    return (
        (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / depth,
        (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / depth,
    )
