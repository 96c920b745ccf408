"""What halves of the tracks show over a video of how far covariances hold."""

from __future__ import annotations

from farpoint.pose.covariance import mean_half_ratio

__all__ = ["HalfRatios"]

# Pairs of frames that the ratio expected at the beginning counts as.
BEFORE = 2
# Pairs after which those long ago are forgotten: a video may come to quite another scene.
MEMORY = 100


class HalfRatios:
    """Mean of `PoseStats.half_ratio` over a video so far.

    That of one pair is rough, and what it tells beside chance is mostly what the camera, the
    tracker and the scene do in every pair: on real video, ratios of neighbouring pairs are no more
    alike than those of any two, but their means differ between videos by a factor of two.

    Parameters
    ----------
    expected : float
        Of the first pair.
    pairs : int
        Number of pairs that this counts as.

    Attributes
    ----------
    mean : float
        Squared differences of halves over what covariances expect of them, without a unit.
    pairs : int
        Number of pairs in the mean, up to `MEMORY`, with those that ``expected`` counts as.
    """

    def __init__(self, expected: float, pairs: int = BEFORE) -> None:
        self.mean = expected
        self.pairs = pairs

    def add(self, ratio: float | None) -> None:
        """Count that of another pair, if it has one."""
        if ratio is not None:
            before = min(self.pairs, MEMORY - 1)
            self.mean = mean_half_ratio(ratio, self.mean, before)
            self.pairs = before + 1
