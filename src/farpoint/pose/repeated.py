"""Repeated structure, one window taken for the next: the motion beside it, not the one between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import COHERENT, coherence_of
from farpoint.pose.options import RelativePoseOptions

__all__ = ["beside_repeated"]

# Fewer repeated matches make no structure.
MANY = 10.0
# Correlation of neighbours' residuals up to which they are noise.
WHITE = 0.15
# Variances that are tried, over the one that was found, and the least share of its matches that
# agree with a motion of so little noise.
NARROWER = tuple(2.0**-k for k in range(2, 8))
LEAST_SHARE = 1.0 / 3.0


def beside_repeated(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> tuple[MovingFit, bool]:
    """The fit; or where neighbours are off alike, one with less noise where they are not.

    And whether they still are: then no other was found.

    Between right matches and repeated ones goes a motion that explains both, with more noise, and
    since many are repeated alike it may be the likeliest. But its residuals are no noise. Those of
    the right motion are, and it is found where no more noise is believed than it needs.
    """
    noise = fit.noise
    repeated = len(matches) * noise.wrong * noise.repeated
    if (repeated < MANY and noise.sigma < tolerance) or coherence_of(fit) < COHERENT:
        return fit, False
    for share in NARROWER:
        narrow = replace(matches, max_variance=share * noise.variance)
        found = fit_moving(narrow, tolerance, options, state)
        if found.agreeing > LEAST_SHARE * fit.agreeing and coherence_of(found) < WHITE:
            return _widened(narrow, found), False
    return fit, True


def _widened(matches: Matches, fit: MovingFit) -> MovingFit:
    """With as much noise as there is while neighbours are not off alike."""
    while fit.noise.variance > 0.99 * matches.max_variance:
        matches = replace(matches, max_variance=2.0 * matches.max_variance)
        wider = refit_moving(matches, fit)
        if coherence_of(wider) > WHITE:
            break
        fit = wider
    return fit
