"""Options of an estimate of two views."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive

__all__ = ["DEFAULTS", "RelativePoseOptions"]


@dataclass(frozen=True, kw_only=True)
class RelativePoseOptions:
    """Options of `estimate_relative_pose`; the defaults serve tracks and still matches alike.

    Attributes
    ----------
    matching_tolerance_px : float
        Largest residual per coordinate, px, at which a match can support a hypothesis of the
        search; a poor calibration needs a larger one. The noise itself is estimated from the data.
        For rays the unit is ``noise_rad``, and the tolerance is at least 3.
    refine : bool
        Refine rotation and direction jointly to the maximum likelihood. False gives the closed
        form of Burschka and Mair (2008): SVD of the far rays, weighted mean of the pairwise
        intersections, covariance from their scatter.
    flow_saturation_px : float
        L of eqs. 14-17: derotated flow of this length, px, has full weight in the mean of the
        pairwise intersections; the weight of shorter flow is proportional to its length.
    confidence : float
        Probability, in (0, 1), that the search has drawn a sample without an outlier.
    min_iterations, max_iterations : int
        Bounds on the number of joint hypotheses in one search; for few matches, at most the number
        of distinct samples of five.
    shared_error_px : float
        1-sigma, px, of an error that is common to all matches. It does not average out over the
        matches and bounds the covariance of the rotation from below. For rays the unit is
        ``noise_rad``.
    count_sharing : bool
        Without given covariances, multiply the covariance by the design effect of residuals that
        are correlated between neighbours. False treats matches as independent.
    half_splits : int
        Number of random splits of the matches into two halves; the difference of their poses scales
        the covariance. 0 for none. Splits are meant for tracks, whose errors are correlated on one
        surface. Patches of 3 to 6 neighbours stay in one half. If residuals of neighbouring patches
        are correlated, too, the covariance of a motion is inflated further.
    expected_half_ratio : float
        Expected split-half ratio: the mean `PoseStats.half_ratio` of earlier pairs of the same
        video, which `Odometry` keeps. It has the weight of 8 splits; without splits it is the only
        factor. 1 for independent noise.
    expected_half_ratio_pairs : int
        Number of pairs in the mean `expected_half_ratio`.
    sharing_beyond_patches : float
        Slope of the variance by errors that are correlated beyond a patch, over the excess of the
        mean split-half ratio above that of independent noise. Video codecs cause such errors; the
        split-half ratio contains only a part of them. 0 for none.
    false_alarm_rate : float
        Probability, in (0, 1), of each of three false alarms: translation for a pure rotation,
        rotation for a static camera, consensus by chance.
    """

    matching_tolerance_px: float = 1.5
    refine: bool = True
    flow_saturation_px: float = 12.0
    confidence: float = 0.999
    min_iterations: int = 16
    max_iterations: int = 2000
    shared_error_px: float = 0.0
    count_sharing: bool = True
    half_splits: int = 0
    expected_half_ratio: float = 1.0
    expected_half_ratio_pairs: int = 2
    sharing_beyond_patches: float = 0.0
    false_alarm_rate: float = 1e-3

    def __post_init__(self) -> None:
        coerce_positive(self, "matching_tolerance_px", "flow_saturation_px")
        ratios = "a ratio, 0.001 to 1000"
        coerce_float(self, ratios, lambda ratio: 1e-3 <= ratio <= 1e3, "expected_half_ratio")
        rates = "confidence", "false_alarm_rate"
        coerce_float(self, "a probability in (0, 1)", lambda rate: 0 < rate < 1, *rates)
        coerce_float(self, "0 px or more", lambda px: px >= 0, "shared_error_px")
        coerce_float(self, "0 or more", lambda slope: slope >= 0, "sharing_beyond_patches")
        coerce_int(self, 1, "expected_half_ratio_pairs")
        coerce_int(self, 0, "min_iterations", "max_iterations", "half_splits")
        if self.min_iterations > self.max_iterations:
            raise InputError(
                "expected min_iterations <= max_iterations, "
                f"got {self.min_iterations} and {self.max_iterations}",
                field="min_iterations",
            )
        for name in ("refine", "count_sharing"):
            if not isinstance(value := getattr(self, name), bool):
                raise InputError(f"expected True or False, got {value!r}", field=name)


# Made once: their validation takes as long as packing 100 matches.
DEFAULTS = RelativePoseOptions()
