"""Matches that go along with the camera: dirt on the lens, the bonnet, a caption.

They stand still in the image while the others move, and agree with each other. Between no motion
and that of the camera goes a third, which explains all of them with more noise, and may be the
likeliest by far.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.evidence import find_standing
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_moving, judge
from farpoint.pose.options import RelativePoseOptions

__all__ = ["without_stuck"]

# A match stands still within so many sigma of the noise.
BY_NOISE = 3.0
# Fewer, or a smaller share of the matches, are wrong as others are. Of more than half that stand
# still, so does the camera.
FEWEST, LEAST_SHARE, MOST_SHARE = 8, 0.05, 0.5


def without_stuck(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> tuple[Matches, MovingFit]:
    """The matches and their fit; without those that are stuck to the image, if some are.

    Those that stand still are stuck if they contradict the motion of the others, and more of these
    agree on it than stand still. What is far stands still, too, where the camera does not turn; it
    contradicts none.
    """
    standing = np.empty(len(matches), bool)
    count = find_standing(matches.pairs, min(BY_NOISE * fit.noise.sigma, tolerance), standing)
    least, most = LEAST_SHARE * len(matches), MOST_SHARE * len(matches)
    if count < FEWEST or not least <= count <= most:
        return matches, fit
    others = matches.select(~standing)
    found = fit_moving(others, tolerance, options, state)
    _, _, probability = judge(matches.select(standing), found)
    if found.agreeing <= count or np.count_nonzero(probability > 0.5) > count / 2:
        return matches, fit
    return others, found
