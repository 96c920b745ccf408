"""Candidate motions beside the one that the search ended at, and the likeliest of all.

The search compares motions by a part of the matches and by their residuals alone. Its answer may be
a local maximum where nearly all points are far, where noise is large, or where the residuals of
neighbours are correlated, so that they are no noise. There other parts of the evidence propose
motions: the flow of rejected matches, the modes that the search met, the rotation of the far
points, and a search with bounded noise. Each is refined by the likelihood of all matches, and the
likeliest counts, if its log likelihood is larger by a margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter

import numpy as np

from farpoint._kernels.contest import GATE_SIGMA
from farpoint._kernels.search import search_direction
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_quietly, refit_moving
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.two_motions import is_correlated
from farpoint.pose.verdict import is_consensus

__all__ = ["CLEAR", "likeliest_motion"]

# Pairs of rejected matches whose directions are tried: where one in four has the direction, a
# hundred pairs miss it with a probability of (1 - 1/16)^100 = 0.002.
PAIRS = 100
# Fewer rejected matches could not contradict a direction that two of them fix.
FEWEST = 6
# Distance of rejected matches from an epipolar line, over the tolerance: the rotation is not yet
# that of their motion.
WIDER = 2.0
# Expected number of directions with such a consensus among wrong matches: none is looked into.
BY_CHANCE = 1.0
# Noise over the tolerance from which on other motions are looked for.
MUCH = 0.4
# Samples of a search with bounded noise.
SAMPLES = 100
# Log likelihood by which another motion must be likelier; and by which more where its flow is
# mostly noise.
CLEAR, OF_NOISE = 8.0, 8.0


def likeliest_motion(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """The fit, or another motion that is clearly likelier.

    Where noise is large, the fit keeps the likeliest of the others, as `MovingFit.unsettled`.
    """
    is_noisy = fit.noise.sigma >= MUCH * tolerance
    starts = [*_of_rejected(matches, fit, tolerance, state)]
    if is_noisy or is_correlated(fit, tolerance):
        starts += _with_less_noise(matches, fit, tolerance, options, state)
        starts += _of_far_points(matches, fit, tolerance, state)
    if not starts:
        return fit
    others = (refit_moving(matches, start) for start in starts)
    found = max(others, key=attrgetter("log_likelihood"))
    if _is_clearly_likelier(found, fit):
        return found
    if not is_noisy:
        return fit
    behind = max(fit.log_likelihood - found.log_likelihood, 0.0)
    other = found.R_cam1_from_cam0, found.direction_cam1_from_cam0, behind
    return replace(fit, unsettled=other)


def _is_clearly_likelier(fit: MovingFit, other: MovingFit) -> bool:
    """Whether a motion is likelier than another by the margin at which it counts."""
    margin = CLEAR + OF_NOISE if fit.is_predicted else CLEAR
    return fit.log_likelihood - other.log_likelihood > margin * other.matches.doubt


def _of_rejected(
    matches: Matches, fit: MovingFit, tolerance: float, state: np.ndarray
) -> Iterator[MovingFit]:
    """The direction in which rejected matches flow, where the motion's own flow is mostly noise.

    Where nearly all points are far, a rotation takes up what the flow has in common, and the few
    near points are rejected.
    """
    rejected = fit.probability < 0.5
    count, within = int(np.count_nonzero(rejected)), WIDER * tolerance
    if not fit.is_predicted or count < FEWEST:
        return
    t = np.empty(3)
    R, apart = fit.far_rotation_cam1_from_cam0.copy(), matches.select(rejected)
    given = apart.pairs, apart.weights(), np.arange(count), within, PAIRS, state
    agreeing = count - int(search_direction(*given, R, t) / within**2)
    if is_consensus(agreeing, count, 2, within / matches.spread, BY_CHANCE):
        yield fit.at(R, t)


def _with_less_noise(
    matches: Matches,
    fit: MovingFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> Iterator[MovingFit]:
    """What a search finds that believes no more noise than a first guess, and the modes met."""
    found = fit_quietly(matches, (tolerance / GATE_SIGMA) ** 2, SAMPLES, tolerance, options, state)
    yield found
    yield from (fit.at(*mode) for mode in (fit.rival, found.rival) if mode is not None)


def _of_far_points(
    matches: Matches, fit: MovingFit, tolerance: float, state: np.ndarray
) -> Iterator[MovingFit]:
    """The closed form of 2008: the rotation of the far points, the epipole of the other flow."""
    rotation = far_rotation(matches, tolerance, state)
    others = matches.select(~rotation.consistent)
    if len(others) < FEWEST:
        return
    R, t = rotation.R_cam1_from_cam0.copy(), np.empty(3)
    given = others.pairs, others.weights(), np.arange(len(others)), tolerance, PAIRS, state
    search_direction(*given, R, t)
    yield fit.at(R, t)
