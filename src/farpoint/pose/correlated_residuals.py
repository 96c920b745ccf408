"""Residuals that are correlated between neighbours, for example on one surface."""

from __future__ import annotations

from dataclasses import replace

from farpoint._kernels.constants import GATE_SIGMA
from farpoint._kernels.covariance import finite_sample_inflation
from farpoint.pose.constants import CORRELATED_Z, DESIGN_EFFECT_FREEDOM, SMOOTH_ERROR_FACTOR
from farpoint.pose.general_motion import GeneralMotionFit
from farpoint.pose.matches import Matches

__all__ = ["count_residual_correlation"]


def count_residual_correlation(
    matches: Matches, fit: GeneralMotionFit
) -> tuple[Matches, GeneralMotionFit]:
    """The matches and the fit, both with the design effect of correlated residuals.

    N matches of a few surfaces carry less information than N independent matches. Without the
    design effect the covariance, the evidence for translation and the odds of two motions would be
    overconfident. The design effect is used only for matches without given covariances, and only if
    the z-score of the correlation is at least `CORRELATED_Z`. If the z-score exceeds `GATE_SIGMA`,
    the noise also counts as misspecified (`Matches.misspecification`).
    """
    if matches.misspecification > 1.0 or fit.neighbours.z_score < CORRELATED_Z:
        return matches, fit
    _, z_score, by_parts = fit.neighbours
    effect = max(
        finite_sample_inflation(DESIGN_EFFECT_FREEDOM) * SMOOTH_ERROR_FACTOR * by_parts, 1.0
    )
    is_misspecified = z_score > GATE_SIGMA
    fitted = fit.matches.with_design_effect(effect, is_misspecified=is_misspecified)
    counted = matches.with_design_effect(effect, is_misspecified=is_misspecified)
    return counted, replace(fit, matches=fitted)
