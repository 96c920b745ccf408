"""What every match is off by beside what was told of it.

The covariances that a tracker tells its tracks are what their windows know. What the windows do not
know (interpolation, blur, surfaces that bend) is the same for all of them, and matters most for
those that are said to be best: unseen, it gives them weights that they do not deserve.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.noise_floor import floor_likelihoods
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, judge

__all__ = ["noise_floor"]

# Floors that are tried, as variances over the median of what was told.
FLOORS = np.array([0.0, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 13.0, 50.0])
# Degrees of freedom of the residuals' distribution: heavier tails than the normal one's.
FREEDOM = 5.0
ROUNDS = 8
# Fewer matches tell nothing of it.
LEAST_MATCHES = 30


def noise_floor(matches: Matches, fit: MovingFit) -> float:
    """Variance that all matches have in common, over the median of what was told of each.

    The residuals ``e`` of right matches, with variances ``v`` told across the epipolar lines, have
    the variance ``a (v + floor)`` with a common factor; of a grid of floors, the most likely by
    Student's distribution. 0 without told noise, and of few matches.
    """
    if matches.told is None:
        return 0.0
    told = judge(matches, fit)[0]
    right = (fit.probability > 0.5) & (np.abs(told) > 1e-9)
    if np.count_nonzero(right) < LEAST_MATCHES:
        return 0.0
    squares = judge(matches.told.alike(), fit)[0, right] ** 2
    # The same residual, once in units of the same noise for all and once of that told of it.
    variances = squares / told[right] ** 2
    log_likelihood = floor_likelihoods(squares, variances, FLOORS, FREEDOM, ROUNDS)
    # Of those as likely but for rounding, the least: the same noise told of all has no floor.
    return float(FLOORS[np.argmax(np.round(log_likelihood, 6))])
