"""The pure rotation with the maximum likelihood.

The pure-rotation model predicts both coordinates of a match. Inliers have normal noise of unknown
scale with a heavy tail, and outliers are uniform. EM estimates the noise scale and the outlier
share together with the rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from farpoint._kernels.constants import (
    GATE_SIGMA,
    MAX_ITERATIONS,
    START_OUTLIER_SHARE,
    START_TAIL_SHARE,
)
from farpoint._kernels.pairs import packed_length
from farpoint._kernels.pure_rotation import fit_rotation
from farpoint.pose.information import symmetric_inverse
from farpoint.pose.matches import Matches
from farpoint.pose.noise import Noise

__all__ = ["PureRotationFit", "fit_pure_rotation", "lazy_pure_rotation"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PureRotationFit:
    """Rotation without translation.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    covariance : ndarray, shape (3, 3)
        Covariance of the rotation if the model is true, rad^2.
    noise : Noise
    distance2 : ndarray, shape (N,)
        Squared Mahalanobis distance of each match from the prediction of the rotation, for a noise
        sigma of 1; 2 degrees of freedom.
    probability : ndarray, shape (N,)
        Inlier probability of each match.
    cost : float
        Mean negative log likelihood of a match.
    laplace_factor : float
        Negative logarithm of the Laplace (Occam) factor; see `GeneralMotionFit`.
    """

    R_cam1_from_cam0: np.ndarray
    covariance: np.ndarray
    noise: Noise
    distance2: np.ndarray
    probability: np.ndarray
    cost: float
    laplace_factor: float


def fit_pure_rotation(matches: Matches, R_start: np.ndarray, tolerance: float) -> PureRotationFit:
    """Maximum-likelihood rotation of all matches, from a start near the maximum."""
    n, size = len(matches), packed_length(len(matches))
    R, information = R_start.copy(), np.empty((3, 3))
    distance2, inlier = np.empty(size), np.empty(size)
    mixture = np.array([(tolerance / GATE_SIGMA) ** 2, START_OUTLIER_SHARE, START_TAIL_SHARE])
    cost, laplace_factor = fit_rotation(
        matches.pairs,
        n,
        matches.outlier_half_width,
        matches.min_variance,
        MAX_ITERATIONS,
        R,
        mixture,
        information,
        distance2,
        inlier,
    )
    return PureRotationFit(
        R_cam1_from_cam0=R,
        covariance=symmetric_inverse(information),
        noise=Noise(*mixture.tolist()),
        distance2=distance2[:n],
        probability=inlier[:n],
        cost=cost / n,
        laplace_factor=laplace_factor,
    )


def lazy_pure_rotation(
    matches: Matches, R_start: np.ndarray, tolerance: float
) -> Callable[[], PureRotationFit]:
    """Function that calls `fit_pure_rotation` once and caches the result.

    Most motions do not need the pure rotation, so it is computed on demand.
    """
    fitted: list[PureRotationFit] = []

    def pure_rotation() -> PureRotationFit:
        if not fitted:
            fitted.append(fit_pure_rotation(matches, R_start, tolerance))
        return fitted[0]

    return pure_rotation
