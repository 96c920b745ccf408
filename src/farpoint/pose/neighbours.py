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

__all__ = ["coherence_of", "doubt_where_alike"]

# Matches that are asked for their neighbour, at the most. Fewer cannot show anything.
ASKED, LEAST_MATCHES = 400, 50
# Correlation of neighbours' residuals, over the root of how many are asked, from which on they are
# likely to be no noise, and plainly are none: that of noise is 1.1 over that root, and exceeds
# these 1 and 0.3 times in a hundred.
LIKELY, PLAIN = 2.5, 3.0
# Of errors that are smooth over more of the image than a quarter of its width and height, its parts
# do not see all: as a factor, by rendered streets that OpenCV's Lucas-Kanade followed.
BEYOND = 1.5
# Degrees of freedom of what so few parts tell, by how it scatters there.
FREEDOM = 12.0


def coherence_of(fit: MovingFit) -> float:
    """Correlation of the residuals of right matches with those of their neighbours.

    Two of the same point, which a detector of features finds again and again, are neighbours, and
    err alike, too. 0 for few matches.
    """
    if len(fit.matches) < LEAST_MATCHES:
        return 0.0
    rows = _right(fit)
    in_order = rows[np.argsort(fit.matches.rays0[rows, 0])]
    return coherence(fit.matches.pairs, fit.residual, in_order, fit.noise.sigma, ASKED)


def doubt_where_alike(
    matches: Matches, fit: MovingFit, coherence: float
) -> tuple[Matches, MovingFit]:
    """The matches and their fit, which count what neighbours share; in doubt where much is plain.

    By their ``coherence``, as of `coherence_of`, where nothing was told of the noise. Hundreds of
    matches of a few surfaces tell less than as many with noise of their own. Who takes them for
    such is too sure of the motion, of a translation, and of which of two motions it was.
    """
    if matches.doubt > 1.0:
        return matches, fit
    likeness = math.sqrt(min(fit.agreeing, ASKED)) * coherence
    if likeness < LIKELY:
        return matches, fit
    sharing, in_doubt = _sharing_of(fit), likeness > PLAIN
    told = fit.matches.that_share(sharing, in_doubt=in_doubt)
    return matches.that_share(sharing, in_doubt=in_doubt), replace(fit, matches=told)


def _sharing_of(fit: MovingFit) -> float:
    """How many times larger the covariance is for the errors that matches share."""
    effect = design_effect(fit.matches.pairs, fit.residual, _right(fit), fit.noise.sigma)
    return max(growth_by_few(FREEDOM) * BEYOND * effect, 1.0)


def _right(fit: MovingFit) -> np.ndarray:
    """Rows of the right matches."""
    return np.flatnonzero(fit.probability > 0.5)
