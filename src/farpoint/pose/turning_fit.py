"""The model of a camera that only turns, fitted to its maximum likelihood.

Rotation alone; a match has no freedom. It is right with normal noise of unknown size, or wrong and
anywhere; the noise and the share of wrong matches are estimated along (EM).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from farpoint._kernels.contest import GATE_SIGMA, START_POOR, START_WRONG
from farpoint._kernels.pairs import packed_length
from farpoint._kernels.turning import fit_rotation
from farpoint.pose.information import symmetric_inverse
from farpoint.pose.matches import Matches
from farpoint.pose.noise import Noise

__all__ = ["TurningFit", "fit_turning", "turning_when_asked"]

MAX_REFINEMENTS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class TurningFit:
    """Rotation without translation.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    covariance : ndarray, shape (3, 3)
        rad^2, if the model is true.
    noise : Noise
    distance2 : ndarray, shape (N,)
        Squared Mahalanobis distance of each match for unit noise, 2 degrees of freedom.
    probability : ndarray, shape (N,)
        Of each match to be right.
    cost : float
        Mean negative log likelihood of a match.
    narrowness : float
        As of `MovingFit`.
    """

    R_cam1_from_cam0: np.ndarray
    covariance: np.ndarray
    noise: Noise
    distance2: np.ndarray
    probability: np.ndarray
    cost: float
    narrowness: float


def fit_turning(matches: Matches, R_start: np.ndarray, tolerance: float) -> TurningFit:
    """Maximum-likelihood rotation of all matches from a start within its basin."""
    n, size = len(matches), packed_length(len(matches))
    R, information = R_start.copy(), np.empty((3, 3))
    distance2, right = np.empty(size), np.empty(size)
    mixture = np.array([(tolerance / GATE_SIGMA) ** 2, START_WRONG, START_POOR])
    cost, narrowness = fit_rotation(
        matches.pairs,
        n,
        matches.spread,
        matches.min_variance,
        MAX_REFINEMENTS,
        R,
        mixture,
        information,
        distance2,
        right,
    )
    return TurningFit(
        R_cam1_from_cam0=R,
        covariance=symmetric_inverse(information),
        noise=Noise(*mixture.tolist()),
        distance2=distance2[:n],
        probability=right[:n],
        cost=cost / n,
        narrowness=narrowness,
    )


def turning_when_asked(
    matches: Matches, R_start: np.ndarray, tolerance: float
) -> Callable[[], TurningFit]:
    """`fit_turning`, done once, when its result is first asked for: most motions do not."""
    fitted: list[TurningFit] = []

    def turned() -> TurningFit:
        if not fitted:
            fitted.append(fit_turning(matches, R_start, tolerance))
        return fitted[0]

    return turned
