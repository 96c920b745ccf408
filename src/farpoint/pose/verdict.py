"""Which of the models the matches speak for, each by a test with a stated false-alarm rate.

1. *Consensus*: could chance alone have made as many matches agree? For a motion, by how much
   likelier they are with it than all wrong: such a ratio exceeds 1 / rate at most at that rate
   (Markov's inequality). For a rotation, by the expected number of such coincidences (an
   a-contrario test: Moisan and Stival, IJCV 2004, DOI 10.1023/B:VISI.0000013094.38752.34).
2. *Translation*: does the distance of the matches from the rotation's prediction exceed what the
   noise across the epipolar lines explains? An F test over the bulk of the matches; or more matches
   with large parallax towards one direction than wrong matches would send there; or a motion that
   makes the matches more than 1 / rate times as likely as a rotation does, each averaged over all
   poses: as above, at most at that rate by chance.
3. *Rotation*: is the rotation distinguishable from none?
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # its parts load on first use

from farpoint._kernels.evidence import NEAR_SIGMA
from farpoint._kernels.settling import MAX_SEARCHED
from farpoint._kernels.turning import Judged, flow_beside_rotation, likelier_moving
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit
from farpoint.pose.small import rotation_vector, size2
from farpoint.pose.turning_fit import TurningFit

__all__ = [
    "is_consensus",
    "is_motion",
    "is_plainly_translating",
    "is_static",
    "shown_translation",
]

# Half-width of the band in which a match counts as agreeing, in sigma.
BAND_SIGMA = 3.0
# The search takes the direction and rotation in which noise looks most like translation: by so much
# the tail of its distribution outweighs that of any one (simulated with 20 to 500 matches).
DIRECTIONS = 300
# Matches that a motion explains by itself.
OWN = 5
# Fewer matches make no bulk.
MIN_BULK = 8


def is_consensus(agreeing: int, total: int, minimal: int, chance: float, rate: float) -> bool:
    """Whether ``agreeing`` of ``total`` matches are more than coincidence, at false-alarm ``rate``.

    Parameters
    ----------
    agreeing, total : int
        Matches that agree with the best hypothesis, and all matches.
    minimal : int
        Matches that fix a hypothesis, and so agree with it for nothing.
    chance : float
        Probability with which a wrong match agrees with a given hypothesis.
    rate : float
        Expected number of hypotheses with such a consensus among wrong matches.
    """
    if agreeing <= minimal:
        return False
    tail = _log_binomial_tail(agreeing - minimal, total - minimal, min(max(chance, 0.0), 1.0))
    return _log_choose(total, minimal) + tail < math.log(rate)


def is_motion(fit: MovingFit, rate: float) -> bool:
    """Whether the matches are more than ``1 / rate`` times likelier with the motion than all wrong.

    Averaged over all motions: one that five matches were fitted to has as much less room around it.
    """
    return fit.agreeing > OWN and fit.log_odds - fit.narrowness > -math.log(rate)


def is_plainly_translating(fit: MovingFit) -> bool:
    """Whether many of the matches that agree contradict every rotation that may fit them.

    The common case, settled without fitting the other model. A tenth of them, and twice as many as
    chance may have put on their epipolar lines: no handful of wrong ones makes it look like this.
    """
    wrong = min(len(fit.matches), MAX_SEARCHED) - fit.supporting
    chance = min(NEAR_SIGMA * fit.noise.sigma / fit.matches.spread, 1.0)
    return fit.beyond_rotation > max(8.0 + 4.0 * wrong * chance, 0.1 * fit.supporting)


def shown_translation(matches: Matches, fit: MovingFit, turning: TurningFit, rate: float) -> float:
    """How much of a translation beside the rotation the flow shows: 1 if one, 0 if none.

    Between the two where it shows one at a higher false-alarm rate than asked for, or only if the
    noise is what was told of it, or where a translation is likelier, but not by as much.
    """
    band = BAND_SIGMA * fit.noise.mean_sigma
    unexplained, near, by_chance, bulk, across, flow = flow_beside_rotation(
        fit.residual, fit.parallax, turning.distance2, turning.probability, band
    )
    # More matches may flow towards the direction than wrong matches would.
    if near and is_consensus(near, unexplained, 2, by_chance / unexplained, rate):
        return 1.0
    shown = _bulk_beyond_noise(bulk, across, flow, matches, rate)
    return max(shown, _likelier_than_turning(fit, turning) / -math.log(rate))


def _likelier_than_turning(fit: MovingFit, turning: TurningFit) -> float:
    """By how much the log likelihood of a motion is larger than that of a rotation, at least 0.

    Averaged over the poses nearby, and of matches that both explain only what is against.
    """
    if fit.agreeing <= OWN:
        return 0.0
    sigma, spread = fit.noise.sigma, fit.matches.spread
    gain = likelier_moving(
        Judged(fit.said[0], fit.parallax, fit.probability, turning.probability),
        sigma,
        2.0 * spread / (math.sqrt(2.0 * math.pi) * sigma),
        math.log(fit.noise.wrong / turning.noise.wrong),
    )
    return max(gain - fit.narrowness + turning.narrowness, 0.0)


def is_static(R_cam1_from_cam0: np.ndarray, covariance: np.ndarray, rate: float) -> bool:
    """Whether a rotation with this covariance (3, 3), rad^2, cannot be told from none."""
    distance2 = size2(rotation_vector(R_cam1_from_cam0), covariance)
    return bool(scipy.special.chdtrc(3.0, distance2) > rate)


def _bulk_beyond_noise(n: int, across: float, flow: float, matches: Matches, rate: float) -> float:
    """F test of the distance from the rotation's prediction against noise across epipolar lines.

    Over the n matches that both models explain: one wrong match along an epipolar line would decide
    the test. What it shows grows with the digits of the false-alarm rate at which it does, up to
    those of the ``rate`` asked for. With many matches the test would find any error in the stated
    noise: the less such an error explains it, the more of a translation there is, and all of one
    beyond the largest.
    """
    if n < MIN_BULK:
        return 0.0
    # Matches without any noise still have that of rounding.
    across = max(across, n * matches.min_variance)
    ratio = max(flow - across, 0.0) / n / (across / (n - 3))
    false_alarms = DIRECTIONS * scipy.special.fdtrc(float(n), n - 3.0, ratio)
    if false_alarms >= 1.0:
        return 0.0
    digits = 1.0 if false_alarms < rate else math.log(false_alarms) / math.log(rate)
    return digits * min(max(2.0 * ratio / matches.doubt - 1.0, 0.0), 1.0) ** 4


def _log_binomial_tail(k: int, n: int, p: float) -> float:
    """Logarithm of the probability of at least ``k`` of ``n``."""
    tail = float(scipy.special.bdtrc(k - 1.0, n, p))
    return math.log(tail) if tail > 0.0 else -math.inf


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
