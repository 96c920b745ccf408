"""How sure a motion is: the covariance of its rotation and direction."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.coherence import coherence
from farpoint._kernels.contest import GATE_SIGMA
from farpoint._kernels.covariance import covariance_around
from farpoint._kernels.halves import MOST, disagreement
from farpoint._kernels.patches import deal
from farpoint._kernels.sharing import ASKED
from farpoint.pose.certainty import fixes_rotation
from farpoint.pose.information import positive
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, pose_of, seen_by
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.patches import patches_of
from farpoint.pose.small import rotation_vector, size2
from farpoint.pose.turning_fit import TurningFit, fit_turning

__all__ = [
    "growth_between_patches",
    "growth_beyond_patches",
    "growth_by_halves",
    "half_ratio",
    "half_ratio_of_turn",
    "mean_half_ratio",
    "moving_covariance",
    "shared_covariance",
]

# Up to this sigma of the direction over both axes, rad, all poses that the covariance allows tell
# about the same.
STRAIGHT_SIGMA = math.radians(2.5)
# Degrees of freedom that what was expected of halves counts, beside what they show.
EXPECTED = 40.0
# Of fewer matches halves are too small: more is expected of them than they differ by, which is 0.65
# to 0.9 of it for 24 to 48 drawn matches.
LEAST_MATCHES = 60
# So many matches are no half: two fix a rotation, and more must tell their noise.
LEAST_HALF = 8
# Halves of matches with independent noise differ by a little less than is expected of them.
OF_NOISE = 0.95
# Correlation of residuals in neighbouring patches up to which halves tell all, and how much larger
# a variance is for what exceeds it. Of most recordings 2 would do, of one with much that reflects
# and moves, and of simulated surfaces that err alike by thrice the noise, 4 is a little short.
ALIKE, STEEPNESS = 0.25, 4.0
# Upper bound of a pair's half ratio in the mean, over the mean: halves that ended at two motions
# altogether do not tell of how tracks err.
MOST_OVER_MEAN = 3.0
# Mean half ratio of uncompressed video, at the most (rendered: 0.91 to 1.07), and the largest
# excess over it that has been measured, of strong compression.
UNCOMPRESSED, MOST_EXCESS = 1.08, 1.0


def moving_covariance(fit: MovingFit) -> np.ndarray:
    """Covariance (5, 5) of ``[dtheta, dbeta]``, rad^2, in the `tangent_basis` of the direction.

    The sandwich ``H^-1 V H^-1`` of the curvature H of the expected likelihood and the variance V of
    its gradient. Since the depths are estimated along, the Gauss-Newton matrix counts the noise in
    the flow as if it were flow; H does not. V is that matrix if the noise is what was found, and
    the scatter of the gradient over the matches whatever it is: both are heard, the scatter the
    more, the more matches there are.

    Where the direction is far from certain, what the matches tell depends on which pose is the
    right one: a rotation that is a little off lengthens all flow, and makes believe that it tells
    more. Then the covariance is that of all the poses that it allows itself, on average.
    """
    covariance = fit.covariance
    if STRAIGHT_SIGMA**2 < covariance[3, 3] + covariance[4, 4] < math.inf:
        covariance = _averaged(fit, covariance)
    return positive(covariance)


def half_ratio(fit: MovingFit, deals: int) -> float | None:
    """Squared difference of the poses by halves of the matches, over what the covariance expects.

    Tracks of one surface err together: some surfaces ask for another motion than others, and which
    of them a pose follows is decided by few. Then half of the tracks lead to a pose farther from
    that of the other half than their noise would take it (delete-d jackknife: Shao and Wu, Ann.
    Stat. 17, 1989, DOI 10.1214/aos/1176347263; of whole patches, since neighbours are not
    independent: Künsch, Ann. Stat. 17, 1989, DOI 10.1214/aos/1176347265). The mean of random
    ``deals``; None without any, and for few matches.
    """
    matches = fit.matches
    if not _halves_tell(matches, deals) or not math.isfinite(fit.covariance[0, 0]):
        return None
    state = np.zeros(1, np.uint64)
    judging = matches.judging(fit.said[0], gives_way=True)
    right, patch = float(np.add.reduce(fit.probability)), patches_of(matches.rays0)
    shown = disagreement(judging, pose_of(fit), right, fit.is_predicted, deals, patch, state)
    return shown / OF_NOISE


def half_ratio_of_turn(matches: Matches, fit: TurningFit, deals: int) -> float | None:
    """As `half_ratio`, of rotations that halves of the matches lead to without a translation.

    Deals of which a half fixes no rotation are left out; 1 where all are.
    """
    if not _halves_tell(matches, deals):
        return None
    n, patch, tolerance = len(matches), patches_of(matches.rays0), GATE_SIGMA * fit.noise.sigma
    state, half, squares = np.zeros(1, np.uint64), np.empty(n, np.int64), []
    for _ in range(deals):
        if not LEAST_HALF <= deal(patch, state, half) <= n - LEAST_HALF:
            continue
        one, other = (
            fit_turning(matches.select(half == k), fit.R_cam1_from_cam0, tolerance) for k in (0, 1)
        )
        expected = one.covariance + other.covariance
        if fixes_rotation(expected):
            apart = rotation_vector(one.R_cam1_from_cam0 @ other.R_cam1_from_cam0.T)
            squares.append(min(size2(apart, expected) / 3.0, MOST))
    return float(np.mean(squares)) if squares else 1.0


def _halves_tell(matches: Matches, deals: int) -> bool:
    """Whether any are dealt, and of enough matches."""
    return deals > 0 and len(matches) >= LEAST_MATCHES


def growth_by_halves(ratio: float | None, expected: float, freedom: int) -> float:
    """How much larger a covariance is than computed, by the `half_ratio` found and expected.

    The former has so many degrees of ``freedom`` in all deals.
    """
    if ratio is None:
        return expected
    return (EXPECTED * expected + freedom * ratio) / (EXPECTED + freedom)


def mean_half_ratio(ratio: float | None, expected: float, pairs: int) -> float:
    """Mean of the `half_ratio` of a pair and of those before, ``expected`` of so many ``pairs``."""
    if ratio is None:
        return expected
    return expected + (min(ratio, MOST_OVER_MEAN * expected) - expected) / (pairs + 1)


def growth_beyond_patches(ratio: float | None, options: RelativePoseOptions) -> float:
    """Factor on a covariance for errors that are correlated over more of the image than a patch.

    Patches dealt to different halves share them, so they cancel in the difference of the halves. A
    codec's errors are correlated over all lengths, from a block to the image: the sum of all in
    proportion to the part that the halves show, ``f = 1 + slope * min(mean - 1.08, 1)``, at least
    1. By the mean over many pairs, since the ratio of one is too rough for a slope as steep.
    """
    expected, pairs = options.expected_half_ratio, options.expected_half_ratio_pairs
    excess = mean_half_ratio(ratio, expected, pairs) - UNCOMPRESSED
    return 1.0 + options.sharing_beyond_patches * min(max(excess, 0.0), MOST_EXCESS)


def growth_between_patches(fit: MovingFit) -> float:
    """How much larger a covariance is than halves of patches tell, as far as patches err alike.

    Where whole surfaces ask for motions of their own, the likelihood has a maximum for each. Halves
    are refined from the one that was found, and stay near it; other matches of the same scene might
    have led to another. So they might where that of most was taken for one that is likelier.
    """
    matches, right = fit.matches, np.flatnonzero(fit.probability > 0.5)
    patch = patches_of(matches.rays0)
    alike = coherence(matches.pairs, fit.residual, right, patch, fit.noise.sigma, ASKED)
    return 1.0 + STEEPNESS * max(max(alike, fit.between) - ALIKE, 0.0)


def _averaged(fit: MovingFit, covariance: np.ndarray) -> np.ndarray:
    """The covariance on average over the poses that it allows."""
    averaged, right = np.empty((5, 5)), float(np.add.reduce(fit.probability))
    seen = seen_by(fit, fit.matches.pairs, fit.said[0])
    covariance_around(seen, right, fit.is_predicted, covariance, averaged)
    return averaged


def shared_covariance(matches: Matches, sigma: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation by which all matches are off alike, by ``sigma``.

    As large as the rotation that moves a typical match by ``sigma``, in units of the noise.
    """
    if sigma == 0.0:
        return np.zeros((3, 3))
    per_unit = 0.5 * float(np.median(1.0 / matches.precision))  # rad^2; both images have noise
    return sigma**2 * per_unit * np.eye(3)
