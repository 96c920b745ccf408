"""A map of the plane at many points: its values and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["PlaneMap"]


class PlaneMap(NamedTuple):
    """Values (a, b) of a map of the plane at points (x, y), and its derivatives; arrays (N,)."""

    a: np.ndarray
    b: np.ndarray
    a_x: np.ndarray
    a_y: np.ndarray
    b_x: np.ndarray
    b_y: np.ndarray

    @property
    def determinant(self) -> np.ndarray:
        """Positive where the map keeps its orientation."""
        return self.a_x * self.b_y - self.a_y * self.b_x

    def newton_step(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far to move (x, y) so that the values become (a, b), to first order."""
        miss_a, miss_b = a - self.a, b - self.b
        inverse = 1.0 / self.determinant
        return (
            (self.b_y * miss_a - self.a_y * miss_b) * inverse,
            (self.a_x * miss_b - self.b_x * miss_a) * inverse,
        )
