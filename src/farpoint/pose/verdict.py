"""Which of the models the matches speak for, each by a test with a stated false-alarm rate.

1. *Consensus*: could chance alone have made as many matches agree? The expected number of such
   coincidences (an a-contrario test: Moisan and Stival, IJCV 2004,
   DOI 10.1023/B:VISI.0000013094.38752.34).
2. *Translation*: does the distance of the matches from the rotation's prediction exceed what the
   noise across the epipolar lines explains? An F test over the bulk of the matches, or more matches
   with large parallax towards one direction than wrong matches would send there.
3. *Rotation*: is the rotation distinguishable from none?
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from farpoint.geometry import so3
from farpoint.pose.fits import MovingFit, TurningFit
from farpoint.pose.matches import Matches

__all__ = ["NEAR_SIGMA", "is_consensus", "is_static", "is_translating"]

# Parallax below this is a far point's, in sigma.
NEAR_SIGMA = 3.0
# Half-width of the band in which a match counts as agreeing, in sigma.
BAND_SIGMA = 3.0


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
    log_hypotheses = _log_choose(total, minimal)
    tail = special.bdtrc(agreeing - minimal - 1, total - minimal, min(max(chance, 0.0), 1.0))
    if tail == 0.0:  # Underflow: far below any rate, but so may be 1 / hypotheses.
        return True
    return log_hypotheses + math.log(tail) < math.log(rate)


def is_translating(matches: Matches, fit: MovingFit, turning: TurningFit, rate: float) -> bool:
    """Whether the flow shows translation beside the rotation."""
    sigma = fit.noise.sigma
    right = fit.probability > 0.5
    parallax = fit.parallax / sigma
    return _bulk_exceeds_noise(fit, turning, right, parallax, rate) or _near_points_agree(
        matches, fit, right, parallax, rate
    )


def is_static(turning: TurningFit, rate: float) -> bool:
    """Whether the rotation cannot be told from none."""
    dtheta = so3.log(turning.R_cam1_from_cam0)
    try:
        distance2 = dtheta @ np.linalg.solve(turning.covariance, dtheta)
    except np.linalg.LinAlgError:
        return False
    return bool(special.chdtrc(3, distance2) > rate)


def _bulk_exceeds_noise(
    fit: MovingFit, turning: TurningFit, right: np.ndarray, parallax: np.ndarray, rate: float
) -> bool:
    """F test of the shift along the epipolar lines against the noise across them.

    Matches far beyond the bulk are left to the other test: one wrong match along an epipolar line
    would decide this one.
    """
    size = np.abs(parallax[right])
    if len(size) < 8:
        return False
    largest = max(2.5 * np.quantile(size, 0.85), 4.0)
    bulk = right & (np.abs(parallax) <= largest)
    n = int(np.count_nonzero(bulk))
    across = np.sum(fit.residual[bulk] ** 2)
    along = np.sum(turning.distance2[bulk]) - across
    # The direction (2) is fitted to the flow along; rotation and direction (5) to that across.
    ratio = along / (n + 2) / fit.noise.mean_sigma**2
    return bool(special.fdtrc(n + 2, max(n - 5, 1), max(ratio, 0.0)) < rate)


def _near_points_agree(
    matches: Matches, fit: MovingFit, right: np.ndarray, parallax: np.ndarray, rate: float
) -> bool:
    """Whether more matches flow towards the direction than wrong matches would by chance."""
    near = right & (parallax > 2.0 * NEAR_SIGMA)
    wrong = ~right
    candidates = int(np.count_nonzero(near | wrong))
    width = math.sqrt(3.0 * np.mean(fit.residual[wrong] ** 2)) if wrong.any() else matches.spread
    # Half of the matches within the band flow the other way.
    chance = 0.5 * min(BAND_SIGMA * fit.noise.sigma / max(width, 1e-12), 1.0)
    return is_consensus(int(np.count_nonzero(near)), candidates, 2, chance, rate)


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
