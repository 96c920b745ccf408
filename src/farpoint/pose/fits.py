"""The two models of a motion, each fitted to its maximum likelihood.

*Moving*: rotation and direction; a match is free along its epipolar line. *Turning*: rotation
alone; a match has no freedom. In both, a match is right with normal noise of unknown size, or wrong
and anywhere; the noise and the share of wrong matches are estimated along (EM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from farpoint._kernels.likelihood import POOR, refine_pose
from farpoint._kernels.rotation import refine_rotation, rotation_distance2, rotation_linearize
from farpoint._kernels.search import (
    GATE_SIGMA,
    START_POOR,
    START_WRONG,
    search_direction,
    search_pose,
)
from farpoint.geometry import so3
from farpoint.pose.far_rotation import FarRotation
from farpoint.pose.information import symmetric_inverse
from farpoint.pose.matches import Matches
from farpoint.pose.options import RelativePoseOptions

__all__ = [
    "MovingFit",
    "TurningFit",
    "fit_moving",
    "fit_turning",
    "least_squares_rotation",
]

# Noise below a thousandth of a pixel is rounding, not information.
MIN_VARIANCE = 1e-6
# Retreat along its epipolar line that noise can cause of a far point, in sigma.
FAR_SIGMA = 3.0
# Log likelihood to which the result is refined: a hundredth of a sigma.
FINE = 1e-4
MAX_REFINEMENTS = 20
# Enough to tell which of two hypotheses is better.
SEARCH_REFINEMENTS = 6
# What parallax is plausible is learnt from the fit, and the fit from what is plausible.
PARALLAX_ROUNDS = 2
# The search looks at this many matches: more make it slower, not surer.
MAX_SEARCHED = 160
# Matches times samples that are tried at least.
FEW_MATCHES = 1000
# With fewer matches that the rotation does not explain, all may carry translation.
MIN_FLOWING = 8


@dataclass(frozen=True, kw_only=True)
class Noise:
    """What the matches were found to be off by.

    Attributes
    ----------
    variance : float
        Of a good match, per coordinate, in units of the noise that was stated.
    wrong : float
        Share of wrong matches.
    poor : float
        Share of poor ones, with `POOR` times the sigma, among the right matches.
    """

    variance: float
    wrong: float
    poor: float

    @property
    def sigma(self) -> float:
        """Of a good match."""
        return math.sqrt(self.variance)

    @property
    def mean_sigma(self) -> float:
        """Root mean square over good and poor matches."""
        return math.sqrt(self.variance * (1.0 + self.poor * (POOR**2 - 1.0)))

    @property
    def array(self) -> np.ndarray:
        """As the kernels take it."""
        return np.array([self.variance, self.wrong, self.poor])


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
    """

    R_cam1_from_cam0: np.ndarray
    covariance: np.ndarray
    noise: Noise
    distance2: np.ndarray
    probability: np.ndarray
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingFit:
    """Rotation and direction of translation.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    noise : Noise
    residual : ndarray, shape (N,)
        Sampson residual of each match for unit noise.
    parallax : ndarray, shape (N,)
        Signed shift along the epipolar line, towards the direction, in units of its own noise for
        unit noise: what is left of the distance from the rotation's prediction.
    probability : ndarray, shape (N,)
        Of each match to be right.
    iterations : int
        Joint hypotheses tried.
    cost : float
        Mean negative log likelihood of a match.
    prior : ndarray, shape (N,)
        Of each match, by where it lies along its epipolar line.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    noise: Noise
    residual: np.ndarray
    parallax: np.ndarray
    probability: np.ndarray
    iterations: int
    cost: float
    prior: np.ndarray


def fit_turning(matches: Matches, R_start: np.ndarray, tolerance: float) -> TurningFit:
    """Maximum-likelihood rotation of all matches from a start within its basin."""
    n = len(matches)
    R = R_start.copy()
    mixture = np.array([(tolerance / GATE_SIGMA) ** 2, START_WRONG, START_POOR])
    information, distance2 = np.empty((3, 3)), np.empty(n)
    probability, poor = np.empty(n), np.empty(n)
    cost = refine_rotation(
        matches.pairs,
        np.ones(n),
        matches.spread,
        MIN_VARIANCE,
        MAX_REFINEMENTS,
        R,
        mixture,
        information,
        distance2,
        probability,
        poor,
    )
    return TurningFit(
        R_cam1_from_cam0=R,
        covariance=symmetric_inverse(information),
        noise=_noise(mixture),
        distance2=distance2,
        probability=probability,
        cost=cost / n,
    )


def fit_moving(
    matches: Matches,
    rotation: FarRotation,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """Maximum-likelihood rotation and direction, searched for from the far rotation.

    The direction that the derotated flow suggests is refined jointly with the rotation. Then
    five-ray hypotheses challenge it: with no far points, or parallax that a rotation can imitate,
    the first answer is a local minimum.
    """
    n = len(matches)
    searched, flowing = matches, np.flatnonzero(~rotation.consistent)
    if n > MAX_SEARCHED:
        rows = np.arange(MAX_SEARCHED) * n // MAX_SEARCHED
        searched, flowing = matches.select(rows), np.flatnonzero(~rotation.consistent[rows])
    if len(flowing) < MIN_FLOWING:
        flowing = np.arange(len(searched))
    R, t = rotation.R_cam1_from_cam0.copy(), np.empty(3)
    mixture = np.empty(3)
    search_direction(searched.pairs, flowing, tolerance, options.min_iterations, state, R, t)
    iterations = search_pose(
        searched.pairs,
        tolerance,
        matches.spread,
        MIN_VARIANCE,
        options.confidence,
        # Few matches leave few samples without a doubtful one: try them all, they cost little.
        min(max(options.min_iterations, FEW_MATCHES // n), options.max_iterations),
        options.max_iterations,
        SEARCH_REFINEMENTS,
        state,
        R,
        t,
        mixture,
    )
    prior = np.ones(n)
    cost, residual, probability = _refine(matches, prior, R, t, mixture)
    for _ in range(PARALLAX_ROUNDS):
        parallax = _parallax(matches, R, t, residual)
        prior = plausible_parallax(parallax, probability, _noise(mixture), matches.spread)
        cost, residual, probability = _refine(matches, prior, R, t, mixture)
    return MovingFit(
        prior=prior,
        R_cam1_from_cam0=R,
        direction_cam1_from_cam0=t,
        noise=_noise(mixture),
        residual=residual,
        parallax=_parallax(matches, R, t, residual),
        probability=probability,
        iterations=iterations,
        cost=cost / n,
    )


def least_squares_rotation(matches: Matches, R_start: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Squared distances (M,) of the matches ``rows`` from the rotation that fits them best.

    In units of the noise; for rotations near ``R_start``, about which the prediction is linear.
    """
    n = len(matches)
    H, g, distance2 = np.empty((3, 3)), np.empty(3), np.empty(n)
    only_good = np.array([1.0, 0.0, 0.0])
    prior = rows.astype(np.float64)
    rotation_linearize(
        matches.pairs, prior, R_start, only_good, 0.0, H, g, distance2, np.empty(n), np.empty(n)
    )
    R = so3.exp(-symmetric_inverse(H) @ g) @ R_start
    rotation_distance2(matches.pairs, R, distance2)
    return distance2[rows]


def _refine(
    matches: Matches, prior: np.ndarray, R: np.ndarray, t: np.ndarray, mixture: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Improve pose and noise in place; cost, residuals and probabilities of being right."""
    n = len(matches)
    residual, probability, poor = np.empty(n), np.empty(n), np.empty(n)
    cost = refine_pose(
        matches.pairs,
        prior,
        matches.spread,
        MIN_VARIANCE,
        FAR_SIGMA,
        FINE,
        MAX_REFINEMENTS,
        R,
        t,
        mixture,
        np.empty((5, 5)),
        residual,
        probability,
        poor,
    )
    return cost, residual, probability


def plausible_parallax(
    parallax: np.ndarray, probability: np.ndarray, noise: Noise, spread: float
) -> np.ndarray:
    """Prior (N,) of each match from where it lies along its epipolar line.

    A wrong match lies anywhere in the image; a right one no farther on than the nearest of the
    others suggest. Up to there the prior is flat: it scales the density of right matches from the
    strip ``2 spread`` to the length of the flat part.

    A wrong match far along the line outweighs all right ones. As many as can be expected to lie in
    the band by chance, and two more that the direction could have chosen to pass through, may not
    vouch for one another.
    """
    sigma = noise.sigma
    p = parallax / sigma
    right = probability > 0.5
    bulk = np.sort(np.abs(p[right & (p > -3.0)]))
    wrong = len(p) - len(bulk)
    # Where no match is off the lines, none is on one by chance.
    captured = min(wrong, 3 + int(np.ceil(2.0 * wrong * 3.0 * sigma / spread)))
    if len(bulk) <= captured or not np.isfinite(bulk[-1]):
        return np.ones(len(p))
    reach = 2.0 * max(float(bulk[-captured - 1]), 3.0)
    beyond = np.maximum(p - reach, 0.0) / (0.2 * reach)
    shape = np.exp(-0.5 * beyond**2)
    return shape * max(2.0 * spread / ((reach + 3.0) * sigma), 1.0)


def _parallax(matches: Matches, R: np.ndarray, t: np.ndarray, residual: np.ndarray) -> np.ndarray:
    distance2 = np.empty(len(matches))
    rotation_distance2(matches.pairs, R, distance2)
    residual = np.minimum(np.abs(residual), 1e150)  # lest the square of rubbish overflow
    towards = (matches.pairs.rays1 - matches.pairs.rays0 @ R.T) @ t
    return np.copysign(np.sqrt(np.maximum(distance2 - residual**2, 0.0)), towards)


def _noise(mixture: np.ndarray) -> Noise:
    variance, wrong, poor = mixture.tolist()
    return Noise(variance=variance, wrong=wrong, poor=poor)
