"""The fit of a motion from end to end, so that Python calls twice and not fourteen times."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.likelihood import clutter_density, explain, refine_pose
from farpoint._kernels.linear import copy
from farpoint._kernels.plausible import plausible_parallax
from farpoint._kernels.rotation import enlarge_rotation, search_rotation
from farpoint._kernels.scratch import index_room, room, scratch
from farpoint._kernels.search import search_pose

__all__ = ["find_motion", "settle_motion"]

# Samples for the rotation that the search begins with.
START_SAMPLES = np.int64(50)
# With fewer matches that the rotation does not explain, all may carry translation.
MIN_FLOWING = 8
# What parallax is plausible is learnt from the fit, and the fit from what is plausible.
PARALLAX_ROUNDS = 2
# Log likelihood to which the result is refined: a thirtieth of a sigma.
FINE = 1e-3
MAX_REFINEMENTS = np.int64(20)


@kernel
def find_motion(
    pairs: np.ndarray,
    prior: np.ndarray,
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
    twins: np.ndarray,
) -> int:
    """Search for the pose from the rotation of the far matches; returns the hypotheses tried.

    As `search.search_pose`. ``far_R`` (3, 3), the identity at first, receives that rotation. The
    other matches may carry translation, and where few are left, all may.
    """
    consistent = room(count)
    search_rotation(pairs, count, tolerance, START_SAMPLES, state, far_R)
    enlarge_rotation(pairs, count, tolerance, far_R, consistent)
    flowing = 0
    for i in range(count):
        flowing += 0 if consistent[i] else 1
    few = flowing < MIN_FLOWING
    candidates = index_room(count if few else flowing)
    taken = 0
    for i in range(count):
        if few or not consistent[i]:
            candidates[taken] = i
            taken += 1
    copy(far_R, R)
    return search_pose(
        pairs,
        prior,
        count,
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
        twins,
    )


@kernel
def settle_motion(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    residual: np.ndarray,
    parallax: np.ndarray,
    right: np.ndarray,
) -> float:
    """Refine a pose by all matches, with what parallax they make plausible; returns its cost.

    As `likelihood.refine_pose`; ``prior`` receives what is plausible, the last three what
    `likelihood.explain` says of each match.
    """
    normal = scratch(6, 6)
    cost = math.inf
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
    return cost
