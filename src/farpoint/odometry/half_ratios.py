"""What halves of the tracks show over a video of how far covariances hold."""

from __future__ import annotations

__all__ = ["HalfRatios"]

# Pairs of frames that the ratio expected at the beginning counts as.
BEFORE = 2
# No pair counts as more than so many times the mean: halves that ended at two motions altogether
# do not tell of how tracks err.
MOST = 3.0
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

    Attributes
    ----------
    mean : float
        Squared differences of halves over what covariances expect of them, without a unit.
    """

    def __init__(self, expected: float) -> None:
        self.mean = expected
        self._pairs = BEFORE

    def add(self, ratio: float | None) -> None:
        """Count that of another pair, if it has one."""
        if ratio is not None:
            self._pairs = min(self._pairs + 1, MEMORY)
            self.mean += (min(ratio, MOST * self.mean) - self.mean) / self._pairs
