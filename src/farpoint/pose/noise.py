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
        Variance of the core of the inliers per coordinate, px^2, or noise_rad^2 if the user gave
        rays. With given covariances, that of a match with the median variance.
    outlier_share : float
        Share of outliers among all matches.
    tail_share : float
        Share of the inliers whose sigma is at least `TAIL_RATIO` times that of the core. Of these
        inliers, the same share has a sigma that is at least `TAIL_RATIO` times larger again, and so
        on (heavy tail).
    repeated_share : float
        Share of repeated-structure outliers among the outliers: matches between neighbouring
        copies of a repeated structure, such as the windows of a house. 0 for a pure rotation, whose
        noise model has no such component.
    """

    variance: float
    outlier_share: float
    tail_share: float
    repeated_share: float = 0.0

    @property
    def sigma(self) -> float:
        """1-sigma of the core of the inliers."""
        return math.sqrt(self.variance)

    @property
    def mean_sigma(self) -> float:
        """Root mean square noise of all inliers, core and heavy tail."""
        return math.sqrt(mean_variance(self.variance, self.tail_share))

    @property
    def array(self) -> np.ndarray:
        """The noise in the format of the kernels."""
        return np.array(self)
