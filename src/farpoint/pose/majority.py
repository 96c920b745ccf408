"""The motion of most matches, where the likeliest one lies between that and another.

What moves by itself has a motion of its own, and so have windows that were taken for the next ones.
Between it and that of the camera goes a third, which explains all matches with more noise, and may
be the likeliest by far. But its residuals are no noise: neighbours are off alike.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from farpoint._kernels.plausible import BAND_SIGMA
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import (
    MovingFit,
    fit_quietly,
    is_plainly_likelier,
    judge,
    refit_moving,
)
from farpoint.pose.options import RelativePoseOptions

__all__ = ["BETWEEN", "majority_motion"]

# Correlation of neighbours' residuals from which on a motion may lie between two; and where more
# than this share of the matches is repeated, so that many of another motion are called wrong.
BETWEEN, BESIDE_REPEATED, MANY_REPEATED = 0.6, 0.4, 0.1
# And its noise, over the tolerance: with less, what neighbours share is what trackers do wrong.
LEAST_NOISE = 0.1
# Sigma of normal noise over what half of it exceeds.
PROBABLE = 1.4826
# Share of the variance that is its own at the least: two of one point share all of it.
LEAST_OWN = 0.05
# Correlation that a split into two motions leaves of its matches' residuals, at the most: errors that
# are smooth over the image, of a shutter or a lens, are so on either side of any split.
EXPLAINED = 0.5 * BETWEEN
# Noise that is believed while the motion of most is searched for, over what each match has of its
# own, and then: what neighbours differ by is more where they belong to two motions.
NARROW, BELIEVED = 0.2, (1.0, 0.5, 0.25, 0.125)
# Samples that are drawn for it at the most: enough where half of the matches are its own.
SAMPLES = 300
# Least share of the matches that it has.
LEAST_SHARE = 1.0 / 3.0
# What another motion has moved is off by more than twice what agrees, but for this share of it;
# and but for this share of what agrees: of a smooth field as many are a little farther off.
OF_MOVED, OF_AGREEING = 1.0 / 3.0, 0.2


def majority_motion(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """The fit; or the motion of most of its matches, if it lies between that and another.

    What neighbours do not share is the noise that each match has of its own. With no more than
    that, either motion is likelier than the one between. Errors that are smooth over the image, of
    a lens or of tracks, are as smooth with less noise, and lead to no other motion: then the fit
    stays, by which all matches are heard. What another motion has moved lies apart, of the matches
    that the fit takes for right: wrong ones lie anywhere. Nor is it worse to have looked twice:
    where what is found is plainly likelier, the first search had missed it.
    """
    many_repeated = fit.noise.wrong * fit.noise.repeated > MANY_REPEATED
    between = BESIDE_REPEATED if many_repeated else BETWEEN
    if fit.coherence < between or fit.noise.sigma < LEAST_NOISE * tolerance:
        return fit
    # As a whole, good matches and poor: where a motion lies between two, many are taken for poor.
    right = fit.probability > 0.5
    sigma = PROBABLE * float(np.median(np.abs(fit.residual[right])))
    own = max(1.0 - fit.coherence, LEAST_OWN) * sigma**2
    narrow = fit_quietly(matches, NARROW * own, SAMPLES, tolerance, options, state)
    off = np.abs(judge(matches, narrow)[0, right])
    for share in BELIEVED:
        if _is_apart(off, BAND_SIGMA * math.sqrt(share * own)):
            found = refit_moving(matches.with_noise_up_to(share * own), narrow)
            is_of_most = found.agreeing > LEAST_SHARE * fit.agreeing
            if is_of_most and found.coherence < EXPLAINED:
                return replace(found, between=fit.coherence)
            break
    found = refit_moving(matches, narrow)
    return found if is_plainly_likelier(found, fit) else fit


def _is_apart(off: np.ndarray, within: float) -> bool:
    """Whether matches that are off by more than ``within`` are no tail of those that agree."""
    agreeing, near = np.count_nonzero(off < within), np.count_nonzero(off < 2.0 * within)
    tail, moved = near - agreeing, off.size - agreeing
    return bool(tail < min(OF_MOVED * moved, OF_AGREEING * agreeing))
