"""Mean split-half ratio over a video (`PoseStats.half_ratio`)."""

from __future__ import annotations

from farpoint.odometry.constants import FIRST_RATIO_PAIRS, MAX_RATIO_PAIRS
from farpoint.pose.covariance import mean_split_half_ratio

__all__ = ["HalfRatios"]


class HalfRatios:
    """Mean of `PoseStats.half_ratio` over the pairs of a video so far.

    The mean is the expected ratio of the next pair. The ratio of a single pair has a large sampling
    error. On real video, ratios of neighbouring pairs are hardly more correlated than ratios of
    distant pairs, so the mean is taken over all earlier pairs. The mean ratios of two videos can
    differ by a factor of 2, so the mean is not taken over several videos.

    Parameters
    ----------
    expected : float
        Initial ratio.
    pairs : int
        Weight of the initial ratio, in pairs.

    Attributes
    ----------
    mean : float
        Mean split-half ratio.
    pairs : int
        Weight of the mean: number of pairs so far plus the initial weight ``pairs``, at most
        `MAX_RATIO_PAIRS`.
    """

    def __init__(self, expected: float, pairs: int = FIRST_RATIO_PAIRS) -> None:
        self.mean = expected
        self.pairs = pairs

    def add(self, ratio: float | None) -> None:
        """Add the ratio of a pair; None is ignored."""
        if ratio is not None:
            before = min(self.pairs, MAX_RATIO_PAIRS - 1)
            self.mean = mean_split_half_ratio(ratio, self.mean, before)
            self.pairs = before + 1
