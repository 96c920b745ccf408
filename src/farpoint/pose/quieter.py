"""Another motion, where the one found calls all matches right and noisy.

The search weighs motions by their residuals alone. Where many matches are wrong and the field of
view is narrow, some motion comes near nearly all of them, with more noise than matches have; where
they would lie along their epipolar lines, it does not ask. So it is held against that of a search
which believes no more noise than a first guess is allowed, and against those that either has met,
by all that the matches tell.
"""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np

from farpoint._kernels.contest import GATE_SIGMA
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_quietly, refit_moving
from farpoint.pose.options import RelativePoseOptions

__all__ = ["quieter_motion"]

# Noise, over the tolerance, from which on another motion is looked for.
MUCH = 0.4
# Samples that are drawn for it at the most.
SAMPLES = 100
# By how much its log likelihood must be larger: of those that were nearer, as many were wrong. And
# by how much more where its flow is mostly noise, as it is of what takes a motion for a turn.
CLEAR, OF_NOISE = 8.0, 8.0


def quieter_motion(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """The fit; or another motion, if that is clearly likelier.

    Looked for where there is much noise. The fit keeps the one that has lost, as
    `MovingFit.unsettled`: what is not clear may be the truth.
    """
    if fit.noise.sigma < MUCH * tolerance:
        return fit
    variance = (tolerance / GATE_SIGMA) ** 2
    quiet = fit_quietly(matches, variance, SAMPLES, tolerance, options, state)
    met = [fit.at(*pose) for pose in (fit.rival, quiet.rival) if pose is not None]
    others = (refit_moving(matches, start) for start in (quiet, *met))
    found = max(others, key=attrgetter("log_likelihood"))
    gain = found.log_likelihood - fit.log_likelihood
    asked = CLEAR + OF_NOISE if found.is_predicted else CLEAR
    if gain > asked * matches.doubt:
        return found
    lost = found.R_cam1_from_cam0, found.direction_cam1_from_cam0, max(-gain, 0.0)
    return replace(fit, unsettled=lost)
