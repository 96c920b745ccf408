"""Size and correlation of the errors of tracks, learned over the pairs of a video."""

from __future__ import annotations

import math
from typing import NamedTuple

from farpoint.pose.constants import (
    CODEC_CORRELATION,
    EXPECTED_RATIO_FREEDOM,
    FIRST_PAIRS,
    MAX_PAIRS,
    MAX_RATIO_OVER_MEAN,
    UNCOMPRESSED_CORRELATION,
)

__all__ = ["NO_EARLIER_PAIRS", "TrackErrors"]


class TrackErrors(NamedTuple):
    """Means over the earlier pairs of a video.

    The values of a single pair have large sampling errors, and those of neighbouring pairs are
    hardly more similar than those of distant pairs. The means of two videos can differ by a factor
    of 2. The means are therefore taken over all earlier pairs, but not over several videos.

    Attributes
    ----------
    half_ratio : float
        Mean split-half ratio (`PoseStats.half_ratio`); 1 for independent errors.
    correlation : float
        Mean correlation of neighbouring residuals (`PoseStats.residual_correlation`).
    pairs : int
        Weight of the means: the number of pairs so far plus the weight of the initial values, at
        most `MAX_PAIRS`.
    """

    half_ratio: float = 1.0
    correlation: float = UNCOMPRESSED_CORRELATION
    pairs: int = FIRST_PAIRS

    def with_pair(self, half_ratio: float | None, correlation: float | None) -> TrackErrors:
        """The means including another pair; unchanged if the pair has no values.

        Before it enters the mean, ``half_ratio`` is limited to `MAX_RATIO_OVER_MEAN` times the
        mean.
        """
        if half_ratio is None or correlation is None:
            return self
        limited = min(half_ratio, MAX_RATIO_OVER_MEAN * self.half_ratio)
        pairs = min(self.pairs, MAX_PAIRS - 1) + 1
        return TrackErrors(
            self.half_ratio + (limited - self.half_ratio) / pairs,
            self.correlation + (correlation - self.correlation) / pairs,
            pairs,
        )

    def inflation_by_halves(self, half_ratio: float | None, freedom: int) -> float:
        """Factor on the covariance: mean of the split-half ratios of this pair and earlier ones.

        The ratios are weighted by degrees of freedom. ``freedom`` is the number of degrees of
        freedom of ``half_ratio``, summed over all splits.
        """
        if half_ratio is None:
            return self.half_ratio
        total = EXPECTED_RATIO_FREEDOM * self.half_ratio + freedom * half_ratio
        return total / (EXPECTED_RATIO_FREEDOM + freedom)

    def expected_inflation(self, slope: float) -> float:
        """Expected factor on the covariance of a pair; ``slope`` as in `common_to_halves`."""
        return self.half_ratio + self.common_to_halves(slope)

    def common_to_halves(self, slope: float) -> float:
        """Variance of errors that both halves have in common, over that of independent errors.

        Common errors cancel in the difference between the halves. Errors of a video codec are
        correlated over all lengths, from a block to the image, so that the correlation of
        neighbouring residuals predicts the part that cancels: ``exp(slope (c - 0.17)) - 1`` for the
        mean correlation c, limited to 0.17 to 0.46.
        """
        correlation = min(max(self.correlation, UNCOMPRESSED_CORRELATION), CODEC_CORRELATION)
        return math.expm1(slope * (correlation - UNCOMPRESSED_CORRELATION))


NO_EARLIER_PAIRS = TrackErrors()
