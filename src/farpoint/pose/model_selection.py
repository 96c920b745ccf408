"""Model selection: tests of consensus, translation and rotation at a false-alarm rate.

1. *Consensus*: do more matches agree than by chance? For a general motion, the likelihood ratio of
   the motion to the hypothesis that all matches are outliers must exceed 1 / rate. If all matches
   are outliers, this happens with a probability of at most the rate (Markov's inequality). For a
   pure rotation, the expected number of hypotheses with so many agreeing matches, if all matches
   are outliers, must be below the rate (an a-contrario test: Moisan and Stival, IJCV 2004,
   DOI 10.1023/B:VISI.0000013094.38752.34).
2. *Translation*: do the matches move along the epipolar lines by more than the noise? One of three
   tests must pass. The first is an F test over the matches that both the general motion and the
   pure rotation explain. The second tests whether more matches flow towards one epipole than by
   chance. The third tests whether the likelihood ratio of the two models exceeds 1 / rate; both
   likelihoods are averaged over nearby poses (Laplace).
3. *Rotation*: does the rotation differ from the identity by more than the noise?
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # its parts load on first use

from farpoint._kernels.constants import GATE_SIGMA, MAX_SEARCHED, MIN_MATCHES, POSE_PARAMETERS
from farpoint._kernels.pure_rotation import (
    MatchProbabilities,
    flow_beside_rotation,
    translation_log_ratio,
)
from farpoint.geometry.so3 import rotation_vector
from farpoint.pose.constants import INDEPENDENT_TESTS, MAX_DIRECTION_SIGMA
from farpoint.pose.general_motion import GeneralMotionFit
from farpoint.pose.matches import Matches
from farpoint.pose.pure_rotation import PureRotationFit
from farpoint.pose.small import size2

__all__ = [
    "is_clearly_translating",
    "is_consensus",
    "is_motion",
    "is_static",
    "is_vague",
    "translation_evidence",
]


def is_consensus(agreeing: int, total: int, minimal: int, chance: float, rate: float) -> bool:
    """Whether more matches agree than by chance, at the false-alarm ``rate``.

    Parameters
    ----------
    agreeing, total : int
        Number of matches that agree with the best hypothesis, and number of all matches.
    minimal : int
        Number of matches from which a hypothesis is computed; these matches agree by construction.
    chance : float
        Probability that an outlier agrees with a given hypothesis.
    rate : float
        False-alarm rate: expected number of hypotheses with so many agreeing matches if all matches
        are outliers.
    """
    if agreeing <= minimal:
        return False
    tail = _log_binomial_tail(agreeing - minimal, total - minimal, min(max(chance, 0.0), 1.0))
    return _log_choose(total, minimal) + tail < math.log(rate)


def is_motion(fit: GeneralMotionFit, rate: float) -> bool:
    """Whether the likelihood ratio of the motion to outliers alone exceeds ``1 / rate``.

    The likelihood of the motion is averaged over nearby motions (Laplace factor), because the
    likelihood of a motion that is fitted to only five matches has a sharp mode.
    """
    return fit.agreeing > POSE_PARAMETERS and fit.log_odds - fit.laplace_factor > -math.log(rate)


def is_clearly_translating(fit: GeneralMotionFit) -> bool:
    """Whether even the best of three rotations leaves many inliers unexplained.

    If so, no pure rotation needs to be fitted, which is the common case. The number of unexplained
    inliers is ``fit.beyond_rotation``, and the number of all inliers is ``fit.supporting``. The
    unexplained inliers must be more than a share of 0.1 of all inliers, and more than 8 plus 4
    times the number of outliers that are expected to lie on their epipolar lines by chance.
    """
    outliers = min(len(fit.matches), MAX_SEARCHED) - fit.supporting
    chance = min(GATE_SIGMA * fit.noise.sigma / fit.matches.outlier_half_width, 1.0)
    return fit.beyond_rotation > max(8.0 + 4.0 * outliers * chance, 0.1 * fit.supporting)


def is_vague(fit: GeneralMotionFit, sigma: float, rate: float) -> bool:
    """Whether a direction with the largest 1-sigma ``sigma``, rad, or its sign is too uncertain."""
    return sigma > MAX_DIRECTION_SIGMA or fit.sign_probability < 1.0 - rate


def translation_evidence(
    matches: Matches, fit: GeneralMotionFit, pure_rotation: PureRotationFit, rate: float
) -> float:
    """Evidence for translation: 1 or more if a test passes at the false-alarm ``rate``, else less.

    The tests are those of the module docstring. The evidence is 1 if more matches flow towards one
    epipole than by chance. Otherwise the evidence is the larger of two numbers: the evidence of the
    F test, 0 to 1 (`_bulk_beyond_noise`), and the log-likelihood ratio of the general motion to the
    pure rotation, divided by ``log(1 / rate)``.
    """
    band = GATE_SIGMA * fit.noise.mean_sigma
    unexplained, near, by_chance, bulk, across, flow = flow_beside_rotation(
        fit.residual, fit.parallax, pure_rotation.distance2, pure_rotation.probability, band
    )
    # Epipole consensus: more matches flow towards the direction than outliers would.
    if near and is_consensus(near, unexplained, 2, by_chance / unexplained, rate):
        return 1.0
    evidence = _bulk_beyond_noise(bulk, across, flow, matches, rate)
    return max(evidence, _log_ratio_to_rotation(fit, pure_rotation) / -math.log(rate))


def _log_ratio_to_rotation(fit: GeneralMotionFit, pure_rotation: PureRotationFit) -> float:
    """Log-likelihood ratio of the general motion to the pure rotation, at least 0.

    Both likelihoods are averaged over nearby poses. A match that both models explain can only lower
    the ratio.
    """
    if fit.agreeing <= POSE_PARAMETERS:
        return 0.0
    sigma, half_width = fit.noise.sigma, fit.matches.outlier_half_width
    gain = translation_log_ratio(
        MatchProbabilities(
            fit.per_match[0], fit.parallax, fit.probability, pure_rotation.probability
        ),
        sigma,
        2.0 * half_width / (math.sqrt(2.0 * math.pi) * sigma),
        math.log(fit.noise.outlier_share / pure_rotation.noise.outlier_share),
    )
    return max(gain - fit.laplace_factor + pure_rotation.laplace_factor, 0.0)


def is_static(R_cam1_from_cam0: np.ndarray, covariance: np.ndarray, rate: float) -> bool:
    """Whether a rotation may be the identity, by a chi-squared test at the false-alarm ``rate``.

    ``covariance`` (3, 3) is the covariance of the rotation, rad^2.
    """
    distance2 = size2(rotation_vector(R_cam1_from_cam0), covariance)
    return bool(scipy.special.chdtrc(3.0, distance2) > rate)


def _bulk_beyond_noise(n: int, across: float, flow: float, matches: Matches, rate: float) -> float:
    """Evidence, 0 to 1, of an F test of the flow along epipolar lines against the noise across.

    The test uses the n matches that both models explain, because one outlier along an epipolar line
    would decide a test over all matches. The evidence is the logarithm of the p-value divided by
    the logarithm of the ``rate``, at most 1, times the factor
    ``min(2 F / misspecification - 1, 1)^4``, where F is the F statistic. Without this factor, a
    test of many matches would take misspecified noise as flow.
    """
    if n < MIN_MATCHES:
        return 0.0
    # Lower bound of the noise: rounding of coordinates.
    across = max(across, n * matches.min_variance)
    ratio = max(flow - across, 0.0) / n / (across / (n - 3))
    false_alarms = INDEPENDENT_TESTS * scipy.special.fdtrc(float(n), n - 3.0, ratio)
    if false_alarms >= 1.0:
        return 0.0
    digits = 1.0 if false_alarms < rate else math.log(false_alarms) / math.log(rate)
    return digits * min(max(2.0 * ratio / matches.misspecification - 1.0, 0.0), 1.0) ** 4


def _log_binomial_tail(k: int, n: int, p: float) -> float:
    """Logarithm of the probability of at least ``k`` successes in ``n`` trials."""
    tail = float(scipy.special.bdtrc(k - 1.0, n, p))
    return math.log(tail) if tail > 0.0 else -math.inf


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
