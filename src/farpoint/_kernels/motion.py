"""The fit of a motion from end to end, so that Python calls once and not fourteen times."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.five_rays import Effort
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.rotation_search import enlarge_rotation, search_rotation
from farpoint._kernels.search import search_pose
from farpoint._kernels.settling import (
    MAX_SEARCHED,
    Found,
    Numbers,
    searched_of,
    settle,
    some_of,
)

__all__ = ["fit_motion"]

# Samples for the rotation that the search begins with.
START_SAMPLES = np.int64(50)
# With fewer matches that the rotation does not explain, all may carry translation.
MIN_FLOWING = 8
# Matches that a rotation from three of them explains by itself.
OWN = 3
# How much farther off matches may be where no others agree, each time, and how often.
WIDER = 4.0
WIDENINGS = 8


def fit_motion(
    matches: PackedMatches, effort: Effort, least_signal: float, state: np.ndarray, found: Found
) -> tuple[int, bool, bool, bool, Numbers]:
    """Search for a pose by some of the matches, and settle it by all.

    Returns the hypotheses tried, whether the other motion of a plane was a rival, whether one
    elsewhere was met that came near, whether any was while others of the matches were not asked,
    and what `settle_motion` does, with the same arguments.

    The search, as of `search.search_pose`, starts at the rotation of the far matches, the identity
    at first; where there are none, at the rotation that most matches roughly agree on. The other
    matches may carry translation, and where few are left, all may.
    """
    some, few = some_of(matches), matches.total <= MAX_SEARCHED
    count = matches.total if few else MAX_SEARCHED
    candidates = find_candidates(some, count, effort.tolerance, state, found.R_far)
    iterations, is_planar, has_met, has_second = _search(
        some, matches, candidates, effort, state, found
    )
    numbers = settle(some, matches, least_signal, found)
    return iterations, is_planar, has_met, has_second and not few, numbers


@kernel
def _search(
    some: np.ndarray,
    matches: PackedMatches,
    candidates: np.ndarray,
    effort: Effort,
    state: np.ndarray,
    found: Found,
) -> tuple[int, bool, bool, bool]:
    """The search of `fit_motion`, by some of the matches."""
    best = Pose(found.R, found.t, found.mixture, np.empty((6, 6)), np.empty(1))
    second = Pose(found.R_second, found.t_second, np.empty(4), np.empty((6, 6)), np.empty(1))
    rival = Pose(found.R_rival, found.t_rival, np.empty(4), np.empty((6, 6)), np.empty(1))
    copy(found.R_far, best.R)
    searched = searched_of(some, matches)
    return search_pose(searched, candidates, effort, state, best, second, rival)


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
    lost = count - flowing <= OWN
    if lost:
        _widen(pairs, count, tolerance, state, R_far, consistent)
    few = lost or flowing < MIN_FLOWING
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
        within *= WIDER
        search_rotation(pairs, count, within, START_SAMPLES, state, R_far)
        if 2 * enlarge_rotation(pairs, count, within, R_far, consistent) > count:
            break
