"""The motion of matches that the one found calls wrong, where its own flow is mostly noise.

Where nearly all points are far, a rotation takes up what they flow alike, and any direction will do
for the rest. The few that are near contradict that, and wrong ones seem to outnumber them. But they
flow on together, to where the camera goes: to the epipole of the remaining flow.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.search import search_direction
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, is_likelier, refit_moving
from farpoint.pose.verdict import is_consensus

__all__ = ["overlooked_motion"]

# Pairs of the others whose directions are tried: where a quarter flow on together, a hundred miss
# them once in six hundred times.
PAIRS = 100
# So few others could not contradict a motion of their own.
FEWEST = 6
# How much farther off they may be than what agrees: the rotation is not yet theirs.
WIDER = 2.0
# Expected number of directions with as many, of wrong matches, from which on none is looked into.
BY_CHANCE = 1.0


def overlooked_motion(
    matches: Matches, fit: MovingFit, tolerance: float, state: np.ndarray
) -> MovingFit:
    """The fit; or the motion that the others show, if it is the likelier.

    Where there are many matches, the search has looked at some, of which a handful may be near; of
    all they are too many to be wrong.
    """
    others = fit.probability < 0.5
    count, within = int(np.count_nonzero(others)), WIDER * tolerance
    if not fit.is_predicted or count < FEWEST:
        return fit
    apart, t = matches.select(others), np.empty(3)
    R, everyone = fit.far_rotation_cam1_from_cam0.copy(), np.arange(count)
    given = apart.pairs, apart.weights(), everyone, within, PAIRS, state
    agreeing = count - int(search_direction(*given, R, t) / within**2)
    if not is_consensus(agreeing, count, 2, within / matches.spread, BY_CHANCE):
        return fit
    found = refit_moving(matches, fit.at(R, t))
    return found if is_likelier(found, fit) else fit
