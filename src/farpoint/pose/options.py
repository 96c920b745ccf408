"""Options of an estimate of two views."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive

__all__ = ["DEFAULTS", "RelativePoseOptions"]


@dataclass(frozen=True, kw_only=True)
class RelativePoseOptions:
    """Options of `estimate_relative_pose`.

    The defaults suit tracks of a video as well as matches of two photographs.

    Attributes
    ----------
    matching_tolerance_px : float
        Largest residual per coordinate, px, at which a match can support a hypothesis of the
        search. A poor calibration needs a larger tolerance. The noise itself is estimated from the
        data. For rays the unit is ``noise_rad``, and the tolerance is at least 3.
    refine : bool
        Refine rotation and direction jointly to the maximum likelihood. False gives the closed
        form of Burschka and Mair (2008): the least-squares rotation of the far rays, the direction
        as the weighted mean of the pairwise intersections of derotated flow, and the covariance
        from the residuals of the far rays and from a jackknife over the other matches.
    flow_saturation_px : float
        Length L in eqs. 14-17, px. Derotated flow of this length or more has full weight in the
        mean of the pairwise intersections. The weight of shorter flow is proportional to the
        length of the flow.
    confidence : float
        Probability, in (0, 1), with which the search must draw at least one sample without outliers
        that converges to the right motion. A higher probability needs more samples.
    min_iterations, max_iterations : int
        Bounds on the number of joint hypotheses of rotation and direction in one search, each from
        a sample of five matches. A search in few matches draws at most ln 2 times the number of
        distinct samples, but at least ``min_iterations`` samples.
    shared_error_px : float
        1-sigma, px, of an error that is common to all matches. A common error does not average out
        over the matches and bounds the covariance of the rotation from below. For rays the unit is
        ``noise_rad``.
    count_sharing : bool
        If no covariances of the points are given, multiply the covariance of the motion by a design
        effect, because residuals of neighbouring matches are correlated. False treats matches as
        independent.
    half_splits : int
        Number of random splits of the matches into two halves; 0 for none. The difference between
        the poses from two halves scales the covariance. Splits are meant for tracks, because errors
        of tracks on one surface are correlated. Matches of one of 16 parts of the image are in the
        same half.
    common_error_slope : float
        Slope s of the inflation for errors that both halves have in common, which video codecs
        cause. The split-half ratio does not contain these errors. With the mean correlation c of
        neighbouring residuals, ``exp(s (c - 0.17)) - 1`` is added to the factor on the covariance;
        c is limited to 0.17 to 0.46. 0 for no inflation.
    false_alarm_rate : float
        Probability, in (0, 1), of each of three false alarms: a translation is reported for a pure
        rotation, a rotation is reported for a static camera, or a chance agreement of matches is
        reported as a motion.
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
    common_error_slope: float = 0.0
    false_alarm_rate: float = 1e-3

    def __post_init__(self) -> None:
        coerce_positive(self, "matching_tolerance_px", "flow_saturation_px")
        rates = "confidence", "false_alarm_rate"
        coerce_float(self, "a probability in (0, 1)", lambda rate: 0 < rate < 1, *rates)
        coerce_float(self, "0 px or more", lambda px: px >= 0, "shared_error_px")
        coerce_float(self, "0 or more", lambda slope: slope >= 0, "common_error_slope")
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


# Made once: the validation of options takes as long as packing 100 matches.
DEFAULTS = RelativePoseOptions()
