"""Residuals that are correlated between neighbours, for example on one surface."""

from __future__ import annotations

from dataclasses import replace

from farpoint._kernels.covariance import finite_sample_inflation
from farpoint._kernels.design_effect import CORRELATED_Z
from farpoint.pose.general_motion import GeneralMotionFit
from farpoint.pose.matches import Matches

__all__ = ["count_residual_correlation"]

# z-score of the residual correlation beyond which the noise counts as misspecified: independent
# noise exceeds it with a probability of 0.003.
SIGNIFICANT = 3.0
# Factor for errors that are smooth over more than 1/4 of the image's width and height, which
# parts of the image cannot show; from rendered streets with OpenCV's Lucas-Kanade tracker.
BEYOND_PARTS = 1.5
# Degrees of freedom of a design effect from few parts, by its scatter on these streets.
FREEDOM = 12.0


def count_residual_correlation(
    matches: Matches, fit: GeneralMotionFit
) -> tuple[Matches, GeneralMotionFit]:
    """The matches and their fit with the design effect of correlated residuals.

    The design effect is used for matches without given covariances only. N matches of a few
    surfaces carry less information than N independent matches: without the design effect the
    covariance, the evidence for translation and the odds of two motions are overconfident. Above
    `SIGNIFICANT` the noise counts as misspecified.
    """
    if matches.misspecification > 1.0 or fit.neighbours.z_score < CORRELATED_Z:
        return matches, fit
    _, z_score, by_parts = fit.neighbours
    effect = max(finite_sample_inflation(FREEDOM) * BEYOND_PARTS * by_parts, 1.0)
    is_misspecified = z_score > SIGNIFICANT
    fitted = fit.matches.with_design_effect(effect, is_misspecified=is_misspecified)
    counted = matches.with_design_effect(effect, is_misspecified=is_misspecified)
    return counted, replace(fit, matches=fitted)
