"""The fit of a motion from end to end, so that Python calls once and not fourteen times."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.contest import narrowness
from farpoint._kernels.covariance import covariance_here
from farpoint._kernels.evidence import NEAR_SIGMA, count_beyond_rotation, weigh
from farpoint._kernels.likelihood import clutter_density, explain, mean_variance, refine_pose
from farpoint._kernels.pairs import LANES, PANEL, take_pairs
from farpoint._kernels.plausible import plausible_parallax
from farpoint._kernels.rotation_search import enlarge_rotation, search_rotation
from farpoint._kernels.scratch import copy, index_room, room, scratch
from farpoint._kernels.search import search_pose

__all__ = ["MAX_SEARCHED", "Settled", "fit_motion", "settle_motion"]

# The search looks at this many matches: more make it slower, not surer.
MAX_SEARCHED = 160
# Samples for the rotation that the search begins with.
START_SAMPLES = np.int64(50)
# With fewer matches that the rotation does not explain, all may carry translation.
MIN_FLOWING = 8
# Matches that a rotation from three of them explains by itself.
OWN = 3
# How much farther off matches may be where no others agree, each time, and how often.
WIDER = 4.0
WIDENINGS = 8
# What parallax is plausible is learnt from the fit, and the fit from what is plausible.
PARALLAX_ROUNDS = 2
# Log likelihood to which the result is refined: a thirtieth of a sigma.
FINE = 1e-3
MAX_REFINEMENTS = np.int64(20)

# Cost, what it grows by when averaged over poses, matches that agree, log odds of the sign of the
# direction; of the right matches searched, those that no rotation explains, and all; whether the
# flow shows a direction.
Settled = tuple[float, float, int, float, int, int, bool]


@kernel
def fit_motion(
    pairs: np.ndarray,
    count: int,
    tolerance: float,
    spread: float,
    min_variance: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
    state: np.ndarray,
    far_R: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    said: np.ndarray,
    labels: np.ndarray,
    sure: np.ndarray,
) -> tuple[int, bool, Settled]:
    """Search for a pose by some of the ``count`` matches in ``pairs``, and settle it by all.

    Returns the hypotheses tried, whether the other motion of a plane was a rival, and what
    `settle_motion` does.

    The search, as of `search.search_pose`, starts at the rotation of the far matches, which
    ``far_R`` (3, 3), the identity at first, receives; where there are none, at the rotation that
    most matches roughly agree on. The other matches may carry translation, and where few are left,
    all may.
    """
    searched, some = _searched(pairs, count)
    prior = room(searched.size // PANEL * LANES)
    _leave_out_none(prior, some)
    candidates = _candidates(searched, some, tolerance, state, far_R)
    copy(far_R, R)
    iterations, is_planar = search_pose(
        searched,
        prior,
        some,
        candidates,
        tolerance,
        spread,
        min_variance,
        confidence,
        min_iterations,
        max_iterations,
        state,
        R,
        t,
        mixture,
    )
    settled = _settle(
        searched,
        some,
        prior,
        pairs,
        count,
        spread,
        min_variance,
        far_R,
        R,
        t,
        mixture,
        said,
        labels,
        sure,
    )
    return iterations, is_planar, settled


@inner_kernel
def _searched(pairs: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """The matches that the search looks at, every so manieth, and how many they are."""
    some = count if count < MAX_SEARCHED else MAX_SEARCHED
    if some == count:
        return pairs, count
    rows, taken = index_room(some), room(some // LANES * PANEL)
    for j in range(some):
        rows[j] = j * count // some
    take_pairs(pairs, rows, taken)
    return taken, some


@inner_kernel
def _leave_out_none(prior: np.ndarray, count: int) -> None:
    """Prior 1 for each match, 0 for those that fill up the panels."""
    for i in range(prior.size):
        prior[i] = 1.0 if i < count else 0.0


@inner_kernel
def _candidates(
    pairs: np.ndarray, count: int, tolerance: float, state: np.ndarray, far_R: np.ndarray
) -> np.ndarray:
    """Find the rotation of the far matches; which others may carry translation."""
    consistent = room(count)
    search_rotation(pairs, count, tolerance, START_SAMPLES, state, far_R)
    enlarge_rotation(pairs, count, tolerance, far_R, consistent)
    flowing = 0
    for i in range(count):
        flowing += 0 if consistent[i] else 1
    lost = count - flowing <= OWN
    if lost:
        _widen(pairs, count, tolerance, state, far_R, consistent)
    few = lost or flowing < MIN_FLOWING
    candidates = index_room(count if few else flowing)
    taken = 0
    for i in range(count):
        if few or not consistent[i]:
            candidates[taken] = i
            taken += 1
    return candidates


@inner_kernel
def _widen(
    pairs: np.ndarray,
    count: int,
    tolerance: float,
    state: np.ndarray,
    far_R: np.ndarray,
    consistent: np.ndarray,
) -> None:
    """Rotation that most matches roughly agree on: the start where none are far.

    Hardly any agree within the noise then, and the best rotation of three rays may be any.
    """
    within = tolerance
    for _ in range(WIDENINGS):
        within *= WIDER
        search_rotation(pairs, count, within, START_SAMPLES, state, far_R)
        if 2 * enlarge_rotation(pairs, count, within, far_R, consistent) > count:
            break


@kernel
def settle_motion(
    pairs: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    far_R: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    said: np.ndarray,
    labels: np.ndarray,
    sure: np.ndarray,
) -> Settled:
    """Refine a pose by all matches, with what parallax they make plausible, and hear them on it.

    As `likelihood.refine_pose`. The rows of ``said`` (4, N) receive what is plausible and, as of
    `likelihood.explain`, residual, parallax and chance to be right of each match; ``labels``
    (count,) what `evidence.weigh` does, and ``sure`` (3, 5, 5) the information, the part of it that
    is noise and the covariance of `covariance.covariance_here`. Returns the cost, its
    `contest.narrowness`, what `evidence.weigh` and, of the matches searched,
    `evidence.count_beyond_rotation` do, with ``far_R`` for another rotation, and what
    `covariance.covariance_here` does.
    """
    searched, some = _searched(pairs, count)
    return _settle(
        searched,
        some,
        room(searched.size // PANEL * LANES),
        pairs,
        count,
        spread,
        min_variance,
        far_R,
        R,
        t,
        mixture,
        said,
        labels,
        sure,
    )


@inner_kernel
def _settle(
    searched: np.ndarray,
    some: int,
    searched_right: np.ndarray,
    pairs: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    far_R: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    said: np.ndarray,
    labels: np.ndarray,
    sure: np.ndarray,
) -> Settled:
    """As `settle_motion`; ``searched_right`` has room for which of the matches searched are."""
    prior, residual, parallax, right = said[0], said[1], said[2], said[3]
    normal = scratch(6, 6)
    cost = math.inf
    clutter = 0.0
    _leave_out_none(prior, count)
    for step in range(PARALLAX_ROUNDS + 1):
        clutter = clutter_density(mixture[0], mixture[1], spread)
        explain(pairs, prior, R, t, mixture, clutter, residual, parallax, right)
        if step < PARALLAX_ROUNDS:
            plausible_parallax(parallax, right, count, math.sqrt(mixture[0]), spread, prior)
            cost = refine_pose(
                pairs,
                prior,
                count,
                spread,
                min_variance,
                FINE,
                MAX_REFINEMENTS,
                R,
                t,
                mixture,
                normal,
            )
    agreeing, odds = weigh(parallax, right, math.sqrt(mixture[0]), labels)
    for j in range(searched_right.size):
        is_right = j < some and right[j * count // some] > 0.5
        searched_right[j] = 1.0 if is_right else 0.0
    # A pose may take some of the flow: a match is off a rotation by twice what its noise would do.
    distance = 2.0 * NEAR_SIGMA * math.sqrt(mean_variance(mixture[0], mixture[2]))
    beyond, supporting = count_beyond_rotation(searched, searched_right, R, far_R, distance)
    total = 0.0
    for i in range(count):
        total += right[i]
    shows = covariance_here(pairs, prior, R, t, mixture, clutter, total, sure[0], sure[1], sure[2])
    return cost, narrowness(normal), agreeing, odds, beyond, supporting, shows
