"""Outliers that are clustered in the image, for example on a moving object."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from farpoint._kernels.clustered_outliers import odds_by_parts
from farpoint._kernels.constants import MIN_MATCHES
from farpoint.pose.general_motion import GeneralMotionFit, refit_general_motion
from farpoint.pose.matches import Matches

__all__ = ["count_clustered_outliers"]


def count_clustered_outliers(
    matches: Matches, fit: GeneralMotionFit, rate: float
) -> GeneralMotionFit:
    """The motion refined with odds of each match by its part of the image (`odds_by_parts`).

    Of a cluster of outliers, some matches agree with the motion by chance. The odds tell them from
    inliers. The fit is returned unchanged if there are fewer than `MIN_MATCHES` outliers, or if the
    outliers are not clustered at the false-alarm ``rate``: if the log likelihood of the parts does
    not exceed that of no parts by ``log(1 / rate)``.
    """
    if np.count_nonzero(fit.probability < 0.5) < MIN_MATCHES:
        return fit
    odds = np.empty(len(matches))
    per_match = fit.probability, fit.residual
    noise, half_width = fit.noise.array, matches.outlier_half_width
    if odds_by_parts(matches.pairs, *per_match, noise, half_width, odds) <= -math.log(rate):
        return fit
    return refit_general_motion(replace(matches, prior_odds=odds), fit)
