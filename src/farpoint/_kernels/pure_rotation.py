"""Maximum-likelihood rotation without translation, and log-likelihood ratio of a translation."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import FAR_SHARES, MIN_KNOWN_SHARE, MIN_MODEL_PROBABILITY, ROUNDING
from farpoint._kernels.rotation import evaluate_rotation, refine_rotation
from farpoint._kernels.vectors import matrix

__all__ = ["MatchProbabilities", "fit_rotation", "flow_beside_rotation", "translation_log_ratio"]


@kernel
def fit_rotation(
    pairs: np.ndarray,
    count: int,
    half_width: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    information: np.ndarray,
    distance2: np.ndarray,
    inlier: np.ndarray,
) -> tuple[float, float]:
    """Maximum-likelihood rotation, and distance and inlier probability of each match.

    The function combines `rotation.refine_rotation` and `rotation.evaluate_rotation`, with the same
    prior for all ``count`` matches. The function returns the cost and the Laplace factor, which is
    that of `hypothesis_comparison.laplace_factor` for the three parameters of a rotation.
    ``information`` (3, 3) receives the information on the rotation, multiplied by two factors below
    1: one because the mixture components of the matches are unknown, one because the noise variance
    is estimated.
    """
    prior = np.empty(inlier.size)
    for i in range(inlier.size):
        prior[i] = 1.0 if i < count else 0.0
    cost = refine_rotation(
        pairs, prior, count, half_width, min_variance, max_iterations, R, mixture, information
    )
    known = evaluate_rotation(pairs, prior, half_width, R, mixture, distance2, inlier)
    supporting = 0.0
    for i in range(inlier.size):
        supporting += inlier[i]
    laplace_factor = 0.5 * math.log(_determinant_beside_one(information))
    _keep_known(known, supporting, information)
    return cost, laplace_factor


@step_kernel
def _determinant_beside_one(H: np.ndarray) -> float:
    """Determinant of ``H + I`` for a symmetric and positive H (3, 3)."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix(H)
    xx, yy, zz = xx + 1.0, yy + 1.0, zz + 1.0
    first = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz)
    return max(first + xz * (xy * yz - yy * xz), 1.0)


@step_kernel
def _keep_known(known: float, supporting: float, information: np.ndarray) -> None:
    freedom = max(2.0 * supporting - 3.0, 4.0)
    share = max(known, MIN_KNOWN_SHARE) * (freedom - 2.0) / freedom
    for i in range(3):
        for j in range(3):
            information[i, j] *= share


@kernel
def flow_beside_rotation(
    residual: np.ndarray,
    parallax: np.ndarray,
    distance2: np.ndarray,
    inlier: np.ndarray,
    band: float,
) -> tuple[int, int, float, int, float, float]:
    """Statistics of the matches near their epipolar lines, for two tests of translation.

    The first test counts the matches that flow towards the direction; the second is an F test.

    A match is consistent with its epipolar line if the ``residual`` (N,) of the match is within
    ``band``. ``distance2`` (N,) is the squared distance of each match from the prediction of the
    rotation, and ``inlier`` (N,) is the inlier probability under the rotation. ``residual``,
    ``parallax``, ``band`` and the distances are in the unit of the noise sigma.

    Returns
    -------
    unexplained, near : int
        Number of outliers of the rotation, and number of these outliers that are consistent with
        their line and flow towards the direction.
    chance : float
        Expected value of ``near`` by chance: the sum, over the outliers, of the probability that an
        outlier is counted in ``near``. By chance, an outlier lies anywhere on a circle around the
        prediction of the rotation. The radius is the distance of the outlier from this prediction.
        The probability is the share of the circle within the band, on the side of the direction.
    consistent : int
        Number of inliers of the rotation that are consistent with their line.
    across, flow : float
        Sums, over the ``consistent`` matches, of the squared residuals and of the squared
        distances.
    """
    outlier_share_of = near = consistent = 0
    chance = across = flow = 0.0
    for i in range(residual.size):
        agrees = abs(residual[i]) <= band
        if inlier[i] < 0.5:
            outlier_share_of += 1
            near += 1 if agrees and parallax[i] > 0.0 else 0
            chance += math.asin(min(band / (math.sqrt(distance2[i]) + 1e-300), 1.0)) / math.pi
        elif agrees and inlier[i] > 0.5:
            consistent += 1
            across += residual[i] * residual[i]
            flow += distance2[i]
    return outlier_share_of, near, chance, consistent, across, flow


class MatchProbabilities(NamedTuple):
    """Evaluation of each match (N,) by a general motion and by a pure rotation."""

    prior: np.ndarray
    """Prior of the parallax by the motion."""
    parallax: np.ndarray
    """Parallax along the epipolar line, as in `likelihood.evaluate_residuals`."""
    inlier: np.ndarray
    """Inlier probability by the motion."""
    rotation_inlier: np.ndarray
    """Inlier probability by the rotation."""


@kernel
def translation_log_ratio(
    matches: MatchProbabilities, sigma: float, lift: float, outlier_log_ratio: float
) -> float:
    """Log-likelihood ratio of a general motion to a pure rotation, over all matches.

    The log ratio is a sum over the matches. The sum over the matches that both models explain is
    set to 0 if it is positive: a rotation explains the common flow of these matches, and their
    residuals under both models are compared by an F test (`flow_beside_rotation`).

    In the fit of the motion, the prior of the parallax is the density of the parallax of the other
    inliers. Here a share of the inliers, 0.5 or 0.9, is far, and the prior of the fit applies only
    to the other inliers. The parallax of far inliers has a normal distribution with one of two
    pairs of parameters: the mean 0 and the noise variance of the motion; or a common mean and a
    variance, both estimated from the matches that both models explain. A common parallax is no
    evidence of a translation, because the pure rotation explains it, too. For the estimated mean
    the log ratio is reduced by ``log(largest parallax / standard error of the mean)``, at least 0
    (Laplace's method without the factor ``1 / sqrt(2 pi)``, because the variance is estimated,
    too). The result is the largest log ratio over both shares and both distributions, minus
    ``log(2)`` for the choice of the share.

    Parameters
    ----------
    matches : MatchProbabilities
    sigma : float
        1-sigma noise of the general motion.
    lift : float
        Density of the parallax of a far match at its mean 0, divided by the density of a match that
        is uniform along the epipolar line.
    outlier_log_ratio : float
        Logarithm of the ratio of the outlier shares under the motion and under the rotation.
    """
    count, middle, variance = _common_parallax(matches, sigma)
    places = max(_largest_parallax(matches, sigma) * math.sqrt(count / variance), 1.0)
    most = -math.inf
    for share in FAR_SHARES:
        most = max(most, _log_ratio(matches, sigma, lift, outlier_log_ratio, share, 0.0, 1.0))
        if count >= 2.0:
            together = _log_ratio(matches, sigma, lift, outlier_log_ratio, share, middle, variance)
            most = max(most, together - math.log(places))
    return most - math.log(len(FAR_SHARES))


@inner_kernel
def _log_ratio(
    matches: MatchProbabilities,
    sigma: float,
    lift: float,
    outlier_log_ratio: float,
    share: float,
    middle: float,
    variance: float,
) -> float:
    """`translation_log_ratio` for one share of far points and one mean and variance of parallax.

    Mean and variance are in sigma.
    """
    both = only = 0.0
    for i in range(matches.parallax.size):
        p = matches.parallax[i] / sigma - middle
        far = share * lift * math.exp(-0.5 * p * p / variance) / math.sqrt(variance)
        far /= max(matches.prior[i], ROUNDING)
        inlier, rotation_inlier = matches.inlier[i], matches.rotation_inlier[i]
        odds = inlier / max(1.0 - inlier, MIN_MODEL_PROBABILITY) * (1.0 - share + far)
        gain = (
            outlier_log_ratio
            + math.log1p(odds)
            + math.log(max(1.0 - rotation_inlier, MIN_MODEL_PROBABILITY))
        )
        if odds > 1.0 and rotation_inlier > 0.5:
            both += gain
        else:
            only += gain
    return only + min(both, 0.0)


@step_kernel
def _largest_parallax(matches: MatchProbabilities, sigma: float) -> float:
    """Largest parallax of the inliers, in sigma."""
    kth_largest = 0.0
    for i in range(matches.parallax.size):
        if matches.inlier[i] > 0.5:
            kth_largest = max(kth_largest, matches.parallax[i] / sigma)
    return kth_largest


@step_kernel
def _common_parallax(matches: MatchProbabilities, sigma: float) -> tuple[float, float, float]:
    """Number of matches that both models explain, and mean and variance of their parallax in sigma.

    The two models are the general motion and the pure rotation.
    """
    count = middle = square = 0.0
    for i in range(matches.parallax.size):
        if matches.inlier[i] > 0.5 and matches.rotation_inlier[i] > 0.5:
            p = matches.parallax[i] / sigma
            count += 1.0
            middle += p
            square += p * p
    middle /= max(count, 1.0)
    return count, middle, 1.0 + max(square / max(count, 1.0) - middle * middle, 0.0)
