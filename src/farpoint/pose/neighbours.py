"""Matches that err as their neighbours do, as those of one surface may: no noise of their own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from farpoint._kernels.coherence import coherence
from farpoint._kernels.covariance import growth_by_few
from farpoint._kernels.sharing import design_effect
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit

__all__ = ["COHERENT", "coherence_of", "doubt_where_alike", "sharing_of"]

# Correlation of neighbours' residuals from which on they are no noise. Nearer ones, in units of the
# noise, are no neighbours but two of the same point, and say nothing of the motion.
COHERENT, ASKED, SAME_POINT = 0.25, 200, 3.0
# And from which on, over the root of how many are asked, they are likely to be none, and plainly
# are: that of noise is 1.1 over that root, and exceeds these 1 and 0.3 times in a hundred. Two of
# the same point, which a detector of features finds again and again, err alike, too.
LIKELY, PLAIN, ASKED_MORE = 2.5, 3.0, 400
# Fewer matches cannot show any.
LEAST_MATCHES = 50
# Of errors that are smooth over more of the image than a quarter of its width and height, its parts
# do not see all: as a factor, by rendered streets that OpenCV's Lucas-Kanade followed.
BEYOND = 1.5
# Degrees of freedom of what so few parts tell, by how it scatters there.
FREEDOM = 12.0


def coherence_of(fit: MovingFit) -> float:
    """Correlation of the residuals of right matches with those of their neighbours."""
    return _correlation(fit, ASKED, SAME_POINT)


def doubt_where_alike(matches: Matches, fit: MovingFit) -> tuple[Matches, MovingFit]:
    """The matches and their fit, which count what neighbours share; in doubt where much is plain.

    Hundreds of matches of a few surfaces tell less than as many with noise of their own. Who takes
    them for such is too sure of the motion, of a translation, and of which of two motions it was.
    """
    if matches.doubt > 1.0 or len(matches) < LEAST_MATCHES:
        return matches, fit
    asked = max(min(fit.agreeing, ASKED_MORE), 1)
    likeness = math.sqrt(asked) * _correlation(fit, ASKED_MORE, 0.0)
    if likeness < LIKELY:
        return matches, fit
    sharing, in_doubt = sharing_of(fit), likeness > PLAIN
    told = fit.matches.that_share(sharing, in_doubt=in_doubt)
    return matches.that_share(sharing, in_doubt=in_doubt), replace(fit, matches=told)


def _correlation(fit: MovingFit, asked: int, same_point: float) -> float:
    rows = _right_in_order(fit)
    return coherence(fit.matches.pairs, fit.residual, rows, fit.noise.sigma, asked, same_point)


def sharing_of(fit: MovingFit) -> float:
    """How many times larger the covariance is for the errors that matches share."""
    rows, sigma = _right_in_order(fit), fit.noise.sigma
    effect = BEYOND * design_effect(fit.matches.pairs, fit.residual, rows, sigma)
    return max(growth_by_few(FREEDOM) * effect, 1.0)


def _right_in_order(fit: MovingFit) -> np.ndarray:
    """Rows of the right matches, by the first coordinate of their rays in camera 0."""
    right = np.flatnonzero(fit.probability > 0.5)
    return right[np.argsort(fit.matches.rays0[right, 0])]
