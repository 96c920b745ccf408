"""A map of the plane at many points: its values and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["PlaneMap"]


class PlaneMap(NamedTuple):
    """Values (a, b) and derivatives of a map of the plane at points (x, y); arrays (N,)."""

    a: np.ndarray
    b: np.ndarray
    a_x: np.ndarray
    a_y: np.ndarray
    b_x: np.ndarray
    b_y: np.ndarray

    @property
    def determinant(self) -> np.ndarray:
        """Determinant of the derivative; positive where the map keeps the plane's orientation."""
        return self.a_x * self.b_y - self.a_y * self.b_x
