"""Mean split-half ratio over a video (`PoseStats.half_ratio`)."""

from __future__ import annotations

from farpoint.odometry.constants import FIRST_RATIO_PAIRS, MAX_RATIO_PAIRS
from farpoint.pose.covariance import mean_split_half_ratio

__all__ = ["HalfRatios"]


class HalfRatios:
    """Mean of `PoseStats.half_ratio` over a video so far.

    The ratio of one pair has a large sampling error. On real video, ratios of neighbouring pairs
    are hardly more correlated than ratios of distant pairs, but the mean ratios of two videos can
    differ by a factor of 2. The mean over the earlier pairs of the video is therefore used.

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
        Number of pairs in the mean, at most `MAX_RATIO_PAIRS`. The initial ratio counts as the
        number of pairs that was given for it.
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
