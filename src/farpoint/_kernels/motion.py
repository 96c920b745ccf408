"""Fit of a general motion: candidates, search, refinement."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.constants import (
    FAR_START_SAMPLES,
    MAX_SEARCHED,
    MIN_MATCHES,
    ROTATION_SAMPLE,
    TOLERANCE_WIDENING,
    TOLERANCE_WIDENINGS,
)
from farpoint._kernels.five_rays import SearchBudget
from farpoint._kernels.motion_refinement import (
    MotionBuffers,
    MotionSummary,
    refine_and_evaluate,
    searched_matches,
    searched_pairs,
)
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.rotation_search import enlarge_rotation, search_rotation
from farpoint._kernels.search import search_pose

__all__ = ["fit_motion"]


def fit_motion(
    matches: PackedMatches,
    budget: SearchBudget,
    least_signal: float,
    state: np.ndarray,
    buffers: MotionBuffers,
) -> tuple[int, bool, bool, MotionSummary]:
    """Search for a pose by a subsample of the matches, and refine the pose by all matches.

    The function returns four results: the number of hypotheses; whether the second motion of a
    plane competes; whether a secondary mode in another direction is within `MODE_MARGIN`; and the
    summary that `refine_motion` returns.

    The search (`search.search_pose`) starts at the rotation of the far matches, which RANSAC finds
    (`rotation_search.search_rotation`). If there are no far matches, the search starts at a
    rotation with which more than 50 % of the matches are consistent at a larger tolerance
    (`_widen`). The direction is searched among the matches that are not far. If no match is far, or
    fewer than `MIN_MATCHES` are not far, the direction is searched among all matches.
    """
    some, few = searched_pairs(matches), matches.total <= MAX_SEARCHED
    count = matches.total if few else MAX_SEARCHED
    candidates = find_candidates(some, count, budget.tolerance, state, buffers.R_far)
    iterations, is_planar, has_secondary = _search(
        some, matches, candidates, budget, state, buffers
    )
    values = refine_and_evaluate(some, matches, least_signal, buffers)
    return iterations, is_planar, has_secondary, values


@kernel
def _search(
    some: np.ndarray,
    matches: PackedMatches,
    candidates: np.ndarray,
    budget: SearchBudget,
    state: np.ndarray,
    buffers: MotionBuffers,
) -> tuple[int, bool, bool]:
    """The search of `fit_motion` in a subsample of the matches."""
    best = Pose(buffers.R, buffers.t, buffers.mixture, np.empty((6, 6)), np.empty(1))
    secondary = Pose(
        buffers.R_secondary, buffers.t_secondary, np.empty(4), np.empty((6, 6)), np.empty(1)
    )
    copy(buffers.R_far, best.R)
    searched = searched_matches(some, matches)
    return search_pose(searched, candidates, budget, state, best, secondary)


@kernel
def find_candidates(
    pairs: np.ndarray, count: int, tolerance: float, state: np.ndarray, R_far: np.ndarray
) -> np.ndarray:
    """Find the rotation of the far matches, and the matches that may show translation.

    The rotation is written to ``R_far``. The function returns the indices of the matches.
    """
    consistent = np.empty(count, np.bool_)
    search_rotation(pairs, count, tolerance, FAR_START_SAMPLES, state, R_far)
    enlarge_rotation(pairs, count, tolerance, R_far, consistent)
    flowing = 0
    for i in range(count):
        flowing += 0 if consistent[i] else 1
    has_no_far = count - flowing <= ROTATION_SAMPLE
    if has_no_far:
        _widen(pairs, count, tolerance, state, R_far, consistent)
    few = has_no_far or flowing < MIN_MATCHES
    candidates = np.empty(count if few else flowing, np.int64)
    taken = 0
    for i in range(count):
        if few or not consistent[i]:
            candidates[taken] = i
            taken += 1
    return candidates


@step_kernel
def _widen(
    pairs: np.ndarray,
    count: int,
    tolerance: float,
    state: np.ndarray,
    R_far: np.ndarray,
    consistent: np.ndarray,
) -> None:
    """Rotation with which more than 50 % of the matches agree at an increased tolerance.

    This rotation is the initial value of the search if there are no far points. Without far points,
    hardly any match is consistent with a rotation at the given tolerance, and which sample of three
    matches is best at this tolerance is left to chance.
    """
    within = tolerance
    for _ in range(TOLERANCE_WIDENINGS):
        within *= TOLERANCE_WIDENING
        search_rotation(pairs, count, within, FAR_START_SAMPLES, state, R_far)
        if 2 * enlarge_rotation(pairs, count, within, R_far, consistent) > count:
            break
