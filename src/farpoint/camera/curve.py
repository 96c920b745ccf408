"""Radial curve of a symmetric lens, increasing up to the end of the field, and its inverse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

__all__ = ["MonotonicCurve", "first_positive_root"]

NODES = 1024
TOLERANCE = 1e-10
ITERATIONS = 20


@dataclass(frozen=True)
class MonotonicCurve:
    """A function of one variable that increases for arguments from 0 to `end`.

    Attributes
    ----------
    function : callable
        Values and slopes of the curve, ``(N,) -> (N,), (N,)``.
    end : float
        Finite argument at which the curve stops increasing.
    """

    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    end: float

    @cached_property
    def table(self) -> tuple[np.ndarray, np.ndarray]:
        """Evenly spaced arguments of the curve, and the values at these arguments."""
        arguments = np.linspace(0.0, self.end, NODES)
        return arguments, self.function(arguments)[0]

    def invert(self, values: np.ndarray) -> np.ndarray:
        """Arguments of these values; NaN for values outside the curve.

        Newton's method refines the arguments from a table to 1e-10.
        """
        arguments, known = self.table
        x = np.interp(values, known, arguments, left=np.nan, right=np.nan)
        for _ in range(ITERATIONS):
            value, slope = self.function(x)
            step = (values - value) / slope
            # The slope is zero at `end`, where Newton's step would be infinite.
            x = np.clip(x + np.where(slope > 0.0, step, 0.0), 0.0, self.end)
            if not np.any(np.abs(step) > TOLERANCE):
                break
        return x


def first_positive_root(coefficients: np.ndarray) -> float:
    """Smallest positive real root of a polynomial ``1 + c1 s + ...``; infinite without such a root.

    The function computes the reciprocals of the roots, which stay finite if the last coefficients
    are zero.
    """
    reciprocals = np.roots(coefficients)
    real = np.abs(reciprocals.imag) < 1e-9 * np.abs(reciprocals)
    largest = np.max(reciprocals.real[real], initial=0.0)
    return float(1.0 / largest) if largest > 1e-300 else np.inf
