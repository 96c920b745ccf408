"""Matches that err as their neighbours do, as those of one surface may: no noise of their own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from farpoint._kernels.coherence import ASKED, coherence
from farpoint._kernels.covariance import growth_by_few
from farpoint._kernels.sharing import design_effect
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit

__all__ = ["COHERENT", "coherence_of", "doubt_where_alike", "sharing_of"]

# Correlation of neighbours' residuals from which on they are no noise.
COHERENT = 0.25
# And from which on, over the root of how many are asked, they are likely to be none: that of noise
# is 1.1 over that root, and exceeds this about once in a hundred times.
LIKELY = 2.5
# Fewer matches cannot show any.
LEAST_MATCHES = 50
# Of errors that are smooth over more of the image than a quarter of its width and height, its parts
# do not see all: as a factor, by rendered streets that OpenCV's Lucas-Kanade followed.
BEYOND = 1.5
# Degrees of freedom of what so few parts tell, by how it scatters there.
FREEDOM = 12.0


def coherence_of(fit: MovingFit) -> float:
    """Correlation of the residuals of right matches with those of their neighbours."""
    return coherence(fit.matches.pairs, fit.residual, _right_in_order(fit), fit.noise.sigma)


def doubt_where_alike(matches: Matches, fit: MovingFit) -> tuple[Matches, MovingFit]:
    """The matches and their fit; with their noise in doubt where neighbours err alike.

    Hundreds of matches of a few surfaces tell less than as many with noise of their own. Who takes
    them for such is too sure of the motion, of a translation, and of which of two motions it was.
    """
    if matches.doubt > 1.0 or len(matches) < LEAST_MATCHES:
        return matches, fit
    asked = max(min(fit.agreeing, ASKED), 1)
    if coherence_of(fit) < LIKELY / math.sqrt(asked):
        return matches, fit
    sharing = sharing_of(fit)
    return matches.in_doubt(sharing), replace(fit, matches=fit.matches.in_doubt(sharing))


def sharing_of(fit: MovingFit) -> float:
    """How many times larger the covariance is for the errors that matches share."""
    rows, sigma = _right_in_order(fit), fit.noise.sigma
    effect = BEYOND * design_effect(fit.matches.pairs, fit.residual, rows, sigma)
    return max(growth_by_few(FREEDOM) * effect, 1.0)


def _right_in_order(fit: MovingFit) -> np.ndarray:
    """Rows of the right matches, by the first coordinate of their rays in camera 0."""
    right = np.flatnonzero(fit.probability > 0.5)
    return right[np.argsort(fit.matches.rays0[right, 0])]
