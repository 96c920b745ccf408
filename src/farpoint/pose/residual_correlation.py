"""Correlation of residuals between neighbouring matches, and its effect on sums of residuals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA, POSE_PARAMETERS
from farpoint._kernels.residual_correlation import neighbour_correlation
from farpoint.pose.constants import CORRELATED_Z, MAX_NEIGHBOUR_QUERIES, MIN_CORRELATED_MATCHES
from farpoint.pose.image_parts import parts_of
from farpoint.pose.matches import Matches

__all__ = ["ResidualCorrelation", "design_effect"]


class ResidualCorrelation(NamedTuple):
    """Correlation between the residuals of neighbouring inliers.

    Attributes
    ----------
    correlation : float
        Correlation coefficient; 0 for few inliers.
    z_score : float
        The correlation times the square root of the number of inliers that were compared with a
        neighbour.
    design_effect : float
        Variance of sums of residuals over parts of the image, divided by the variance of such sums
        for independent residuals (`design_effect`); 1 if the z-score is below `CORRELATED_Z`.
    """

    correlation: float
    z_score: float
    design_effect: float

    @classmethod
    def of(
        cls, matches: Matches, residual: np.ndarray, probability: np.ndarray
    ) -> ResidualCorrelation:
        """The correlation of ``residual`` (N,) in sigma, given inlier probabilities (N,)."""
        rows = (probability > 0.5).nonzero()[0]
        if len(rows) < MIN_CORRELATED_MATCHES:
            return cls(0.0, 0.0, 1.0)
        rays = matches.rays0
        rows = rows[rays[rows, 0].argsort(kind="stable")]
        bounded = np.minimum(np.maximum(residual[rows], -GATE_SIGMA), GATE_SIGMA)
        correlation = neighbour_correlation(matches.pairs, rows, bounded, MAX_NEIGHBOUR_QUERIES)
        z_score = math.sqrt(min(len(rows), MAX_NEIGHBOUR_QUERIES)) * correlation
        if z_score < CORRELATED_Z:
            return cls(correlation, z_score, 1.0)
        return cls(correlation, z_score, design_effect(rays[rows], bounded))


def design_effect(rays: np.ndarray, residual: np.ndarray) -> float:
    """Variance of sums of residuals, divided by that of independent residuals (Kish's deff).

    The image is divided into 16 parts by the ``rays`` (N, 3) of the matches (`parts_of`); p of the
    parts contain matches. S is the sum of the n residuals of a part. If residuals are independent,
    the sum of ``S^2 / n`` over the p parts has the expectation ``p - 5`` times the mean squared
    residual, because the pose has 5 degrees of freedom. The result is the sum divided by this
    expectation (Kish, "Survey Sampling", 1965), or 1 if p is at most 5.
    """
    part = parts_of(rays)
    sizes, sums, square = np.bincount(part), np.bincount(part, residual), float(residual @ residual)
    used = sizes > 0
    freedom = int(np.count_nonzero(used)) - POSE_PARAMETERS
    if not (square > 0.0 and freedom > 0):
        return 1.0
    scatter = float(np.sum(sums[used] ** 2 / sizes[used]))
    return scatter * len(residual) / (square * freedom)
