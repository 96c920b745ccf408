"""What the matches were found to be off by."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.mixture import mean_variance

__all__ = ["MIN_VARIANCE", "Noise"]

# Noise below a thousandth of a pixel is rounding, not information.
MIN_VARIANCE = 1e-6


class Noise(NamedTuple):
    """What the matches were found to be off by.

    Attributes
    ----------
    variance : float
        Of a good match, per coordinate, in units of the noise that was stated.
    wrong : float
        Share of wrong matches.
    poor : float
        Share of poor ones, with `POOR` times the sigma, among the right matches; among these, of
        those with as much again; and among those.
    repeated : float
        Share of repeated ones, one window taken for the next, among the wrong matches; 0 for a
        rotation, which takes none for such.
    """

    variance: float
    wrong: float
    poor: float
    repeated: float = 0.0

    @property
    def sigma(self) -> float:
        """Of a good match."""
        return math.sqrt(self.variance)

    @property
    def mean_sigma(self) -> float:
        """Root mean square over good and poor matches."""
        return math.sqrt(mean_variance(self.variance, self.poor))

    @property
    def array(self) -> np.ndarray:
        """As the kernels take it."""
        return np.array(self)
