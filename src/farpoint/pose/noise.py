"""The estimated noise of matches: a mixture of inliers, a heavy tail and outliers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.mixture import mean_variance

__all__ = ["Noise"]


class Noise(NamedTuple):
    """The estimated noise of matches.

    Attributes
    ----------
    variance : float
        Variance of an inlier of the core, per coordinate, in units of the given noise.
    outlier_share : float
        Share of outliers among all matches.
    tail_share : float
        Share of the inliers that have `TAIL_RATIO` times the sigma of the core; of these, the same
        share has `TAIL_RATIO` times more, and so on (heavy tail).
    repeated_share : float
        Share of repeated-structure outliers (one window matched to the next) among the outliers; 0
        for a pure rotation, which has no such component.
    """

    variance: float
    outlier_share: float
    tail_share: float
    repeated_share: float = 0.0

    @property
    def sigma(self) -> float:
        """Of an inlier of the core."""
        return math.sqrt(self.variance)

    @property
    def mean_sigma(self) -> float:
        """Root mean square over core and heavy tail."""
        return math.sqrt(mean_variance(self.variance, self.tail_share))

    @property
    def array(self) -> np.ndarray:
        """As the kernels take it."""
        return np.array(self)
