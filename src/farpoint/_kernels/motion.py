"""The fit of a motion from end to end, so that Python calls once and not fourteen times."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.five_rays import SearchBudget
from farpoint._kernels.motion_refinement import (
    MAX_SEARCHED,
    MotionBuffers,
    SummaryValues,
    refine_and_evaluate,
    searched_matches,
    searched_pairs,
)
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.rotation_search import enlarge_rotation, search_rotation
from farpoint._kernels.search import search_pose

__all__ = ["fit_motion"]

# Samples for the rotation that the search begins with.
START_SAMPLES = np.int64(50)
# With fewer matches that the rotation does not explain, all may carry translation.
MIN_CANDIDATES = 8
# Matches that a rotation from three of them explains by itself.
SAMPLE_SIZE = 3
# How much farther off matches may be where no others agree, each time, and how often.
WIDENING = 4.0
WIDENINGS = 8


def fit_motion(
    matches: PackedMatches,
    budget: SearchBudget,
    least_signal: float,
    state: np.ndarray,
    buffers: MotionBuffers,
) -> tuple[int, bool, bool, bool, SummaryValues]:
    """Search for a pose by some of the matches, and settle it by all.

    Returns the hypotheses tried, whether the other motion of a plane was a rival, whether one
    elsewhere was met that came near, whether any was while others of the matches were not asked,
    and what `refine_motion` does, with the same arguments.

    The search, as of `search.search_pose`, starts at the rotation of the far matches, the identity
    at first; where there are none, at the rotation that most matches roughly agree on. The other
    matches may carry translation, and where few are left, all may.
    """
    some, few = searched_pairs(matches), matches.total <= MAX_SEARCHED
    count = matches.total if few else MAX_SEARCHED
    candidates = find_candidates(some, count, budget.tolerance, state, buffers.R_far)
    iterations, is_planar, has_secondary, has_close = _search(
        some, matches, candidates, budget, state, buffers
    )
    values = refine_and_evaluate(some, matches, least_signal, buffers)
    return iterations, is_planar, has_secondary, has_close and not few, values


@kernel
def _search(
    some: np.ndarray,
    matches: PackedMatches,
    candidates: np.ndarray,
    budget: SearchBudget,
    state: np.ndarray,
    buffers: MotionBuffers,
) -> tuple[int, bool, bool, bool]:
    """The search of `fit_motion`, by some of the matches."""
    best = Pose(buffers.R, buffers.t, buffers.mixture, np.empty((6, 6)), np.empty(1))
    close = Pose(buffers.R_close, buffers.t_close, np.empty(4), np.empty((6, 6)), np.empty(1))
    secondary = Pose(
        buffers.R_secondary, buffers.t_secondary, np.empty(4), np.empty((6, 6)), np.empty(1)
    )
    copy(buffers.R_far, best.R)
    searched = searched_matches(some, matches)
    return search_pose(searched, candidates, budget, state, best, close, secondary)


@kernel
def find_candidates(
    pairs: np.ndarray, count: int, tolerance: float, state: np.ndarray, R_far: np.ndarray
) -> np.ndarray:
    """Find the rotation of the far matches; which others may carry translation."""
    consistent = np.empty(count)
    search_rotation(pairs, count, tolerance, START_SAMPLES, state, R_far)
    enlarge_rotation(pairs, count, tolerance, R_far, consistent)
    flowing = 0
    for i in range(count):
        flowing += 0 if consistent[i] else 1
    lost = count - flowing <= SAMPLE_SIZE
    if lost:
        _widen(pairs, count, tolerance, state, R_far, consistent)
    few = lost or flowing < MIN_CANDIDATES
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
    """Rotation that most matches roughly agree on: the start where none are far.

    Hardly any agree within the noise then, and the best rotation of three rays may be any.
    """
    within = tolerance
    for _ in range(WIDENINGS):
        within *= WIDENING
        search_rotation(pairs, count, within, START_SAMPLES, state, R_far)
        if 2 * enlarge_rotation(pairs, count, within, R_far, consistent) > count:
            break
