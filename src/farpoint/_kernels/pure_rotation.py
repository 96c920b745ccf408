"""The fit of a rotation alone from end to end, and what speaks for a translation beside it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.rotation import evaluate_rotation, refine_rotation
from farpoint._kernels.vectors import matrix

__all__ = ["MatchProbabilities", "fit_rotation", "flow_beside_rotation", "translation_log_ratio"]

# No less of the information is there without knowing which matches are wrong.
MIN_KNOWN = 0.1
# Of the right matches of a motion, as many may be far as are near; or all but one in ten.
FAR_SHARES = (0.5, 0.9)
# No match is right, or wrong, beyond this doubt.
MIN_COMPLEMENT = 1e-15
# A match of less was not plausible of the motion at all.
MIN_PRIOR = 1e-12


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
    """Maximum-likelihood rotation and what it makes of each match.

    As `rotation.refine_rotation` and `rotation.evaluate_rotation`, all ``count`` matches alike.
    Returns the cost, and what that grows by when averaged over rotations, as `hypothesis_comparison.laplace_factor`.
    ``information`` (3, 3) receives that of the rotation, less what is not known of the matches, and
    of the noise, as for a motion.
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
    """Determinant of ``H + 1``, H symmetric (3, 3) and positive."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix(H)
    xx, yy, zz = xx + 1.0, yy + 1.0, zz + 1.0
    first = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz)
    return max(first + xz * (xy * yz - yy * xz), 1.0)


@step_kernel
def _keep_known(known: float, supporting: float, information: np.ndarray) -> None:
    freedom = max(2.0 * supporting - 3.0, 4.0)
    share = max(known, MIN_KNOWN) * (freedom - 2.0) / freedom
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
    """How matches lie about their epipolar lines, those that a rotation explains and the others.

    A match agrees with its line within ``band`` of the ``residual`` (N,). ``distance2`` (N,) is the
    square of its distance from where the rotation has it, ``inlier`` (N,) the probability that this
    one explains it; all for unit noise.

    Returns
    -------
    unexplained, near : int
        Matches that the rotation does not explain; of these, those that agree, flow along their
        line towards the direction and so may be near.
    chance : float
        Sum of the probabilities that the former are near by chance. A wrong match lies anywhere
        around where the rotation has it, at its own distance: this is the arc of that circle, on
        the side of the direction, that the band takes up.
    bulk : int
        Matches that the rotation explains and that agree.
    across, flow : float
        Sums over these of the squares of the residuals and of the distances.
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
    """What a motion and a rotation make of each match (N,)."""

    prior: np.ndarray
    """What was plausible of it by the motion."""
    parallax: np.ndarray
    """Shift along the epipolar line for unit noise."""
    inlier: np.ndarray
    """Probability of being right by the motion."""
    rotation_inlier: np.ndarray
    """Probability of being right by the rotation."""


@kernel
def translation_log_ratio(
    matches: MatchProbabilities, sigma: float, lift: float, outlier_log_ratio: float
) -> float:
    """By how much the log likelihood of the matches is larger by a motion than by a rotation.

    Of matches that both explain, only if they are against the motion: how they are off the rotation
    is for another test to say.

    The motion took right matches to be where others are. Here a share of them is far, either of
    two, and there as often as the noise puts them: at infinity, or together somewhere else, where a
    rotation takes what they all shift by for its own. Where that is, and how far they spread, is
    found from those that both explain, and costs what one place is of all, up to the nearest right
    match (Laplace's method; its ``2 pi`` is left to pay for the spread).

    Parameters
    ----------
    judged : Judged
    sigma : float
        Noise of the motion.
    lift : float
        Density of a far match at its place, over that of one anywhere on the line.
    wrong : float
        Log of the share of wrong matches by the motion, over that by the rotation.
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
    """As `translation_log_ratio`, if such a share is far, and lies about there, in sigma."""
    both = only = 0.0
    for i in range(matches.parallax.size):
        p = matches.parallax[i] / sigma - middle
        far = share * lift * math.exp(-0.5 * p * p / variance) / math.sqrt(variance)
        far /= max(matches.prior[i], MIN_PRIOR)
        inlier, rotation_inlier = matches.inlier[i], matches.rotation_inlier[i]
        odds = inlier / max(1.0 - inlier, MIN_COMPLEMENT) * (1.0 - share + far)
        gain = (
            outlier_log_ratio
            + math.log1p(odds)
            + math.log(max(1.0 - rotation_inlier, MIN_COMPLEMENT))
        )
        if odds > 1.0 and rotation_inlier > 0.5:
            both += gain
        else:
            only += gain
    return only + min(both, 0.0)


@step_kernel
def _largest_parallax(matches: MatchProbabilities, sigma: float) -> float:
    """Of the right matches, in sigma."""
    kth_largest = 0.0
    for i in range(matches.parallax.size):
        if matches.inlier[i] > 0.5:
            kth_largest = max(kth_largest, matches.parallax[i] / sigma)
    return kth_largest


@step_kernel
def _common_parallax(matches: MatchProbabilities, sigma: float) -> tuple[float, float, float]:
    """Number of matches that both explain; mean of their parallax and its variance, in sigma."""
    count = middle = square = 0.0
    for i in range(matches.parallax.size):
        if matches.inlier[i] > 0.5 and matches.rotation_inlier[i] > 0.5:
            p = matches.parallax[i] / sigma
            count += 1.0
            middle += p
            square += p * p
    middle /= max(count, 1.0)
    return count, middle, 1.0 + max(square / max(count, 1.0) - middle * middle, 0.0)
