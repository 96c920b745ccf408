"""What a user can choose about an estimate."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import settle_float, settle_int, settle_positive

__all__ = ["DEFAULTS", "RelativePoseOptions"]


@dataclass(frozen=True, kw_only=True)
class RelativePoseOptions:
    """Options of `estimate_relative_pose`; the defaults serve tracks and still matches alike.

    Attributes
    ----------
    matching_tolerance_px : float
        Largest residual per coordinate, px, at which a match can support a hypothesis of the
        search; a poor calibration needs a larger one. The noise itself is estimated from the data.
        For rays it is counted in multiples of ``noise_rad`` and taken at least as 3.
    refine : bool
        Refine rotation and direction jointly to the maximum likelihood. False gives the closed
        form of Burschka and Mair (2008): SVD of the far rays, weighted mean of the pairwise
        intersections, covariance from their scatter.
    flow_saturation_px : float
        L of eqs. 14-17: derotated flow of this length, px, has full weight in the mean of the
        pairwise intersections, shorter flow a weight in proportion.
    confidence : float
        Probability, in (0, 1), that the search has drawn a sample without a wrong match.
    min_iterations, max_iterations : int
        Bounds on the number of joint hypotheses tried in one search; of few matches, no more than
        there are samples of five.
    shared_error_px : float
        1-sigma, px, by which all matches may be off in one way: no number of them averages it away,
        and the covariance of the rotation is never less. As `matching_tolerance_px` for rays.
    count_sharing : bool
        Count what matches have in common where neighbours err alike and nothing was told of their
        noise. False takes them for independent.
    half_deals : int
        How often the matches are dealt into two halves, by whose poses the covariance is corrected;
        0 for never. For tracks: those of one surface err together. Patches of three to six that
        lie together go to the same half; where neighbouring patches err alike, too, the covariance
        of a motion is larger than halves tell.
    expected_half_ratio : float
        What the halves are expected to show: the mean `PoseStats.half_ratio` of earlier pairs of
        the same video, which `Odometry` keeps. It counts as much as 8 deals do, and alone where
        there are none. 1 is what independent noise shows.
    expected_half_ratio_pairs : int
        Number of pairs that `expected_half_ratio` is the mean of, in the mean with this pair.
    sharing_beyond_patches : float
        Slope of the variance that errors correlated beyond a patch add, by the excess of the mean
        half ratio over that of independent noise: video codecs leave such errors, and halves of
        patches show a part of them only. 0 for none.
    false_alarm_rate : float
        Probability, in (0, 1), with which a camera that only turned may be said to have moved, one
        that stood still to have turned, and chance to have been a consensus.
    """

    matching_tolerance_px: float = 1.5
    refine: bool = True
    flow_saturation_px: float = 12.0
    confidence: float = 0.999
    min_iterations: int = 16
    max_iterations: int = 2000
    shared_error_px: float = 0.0
    count_sharing: bool = True
    half_deals: int = 0
    expected_half_ratio: float = 1.0
    expected_half_ratio_pairs: int = 2
    sharing_beyond_patches: float = 0.0
    false_alarm_rate: float = 1e-3

    def __post_init__(self) -> None:
        settle_positive(self, "matching_tolerance_px", "flow_saturation_px")
        ratios = "a ratio, 0.001 to 1000"
        settle_float(self, ratios, lambda ratio: 1e-3 <= ratio <= 1e3, "expected_half_ratio")
        rates = "confidence", "false_alarm_rate"
        settle_float(self, "a probability in (0, 1)", lambda rate: 0 < rate < 1, *rates)
        settle_float(self, "0 px or more", lambda px: px >= 0, "shared_error_px")
        settle_float(self, "0 or more", lambda slope: slope >= 0, "sharing_beyond_patches")
        settle_int(self, 1, "expected_half_ratio_pairs")
        settle_int(self, 0, "min_iterations", "max_iterations", "half_deals")
        if self.min_iterations > self.max_iterations:
            raise InputError(
                "expected min_iterations <= max_iterations, "
                f"got {self.min_iterations} and {self.max_iterations}",
                field="min_iterations",
            )
        for name in ("refine", "count_sharing"):
            if not isinstance(value := getattr(self, name), bool):
                raise InputError(f"expected True or False, got {value!r}", field=name)


# Made once: to check them takes as long as to read a hundred matches.
DEFAULTS = RelativePoseOptions()
