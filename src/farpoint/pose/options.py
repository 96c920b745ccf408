"""What a user can choose about an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from farpoint.errors import InputError

__all__ = ["RelativePoseOptions"]


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
        Bounds on the number of joint hypotheses tried in one search.
    false_alarm_rate : float
        Probability, in (0, 1), with which a camera that only turned may be said to have moved, one
        that stood still to have turned, and chance to have been a consensus.
    """

    matching_tolerance_px: float = 1.5
    refine: bool = True
    flow_saturation_px: float = 12.0
    confidence: float = 0.9999
    min_iterations: int = 24
    max_iterations: int = 2000
    false_alarm_rate: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("matching_tolerance_px", "flow_saturation_px"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise InputError(f"expected a positive number of pixels, got {value!r}", field=name)
        for name in ("confidence", "false_alarm_rate"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(
                    f"expected a probability in (0, 1), got {getattr(self, name)!r}", field=name
                )
        if not 0 <= self.min_iterations <= self.max_iterations:
            raise InputError(
                f"expected 0 <= min_iterations <= max_iterations, got {self.min_iterations!r} and "
                f"{self.max_iterations!r}",
                field="min_iterations",
            )
