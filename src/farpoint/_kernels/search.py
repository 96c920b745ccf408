"""Search for the pose: directions at a known rotation, then joint hypotheses against the best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.epipolar import parallax
from farpoint._kernels.five_rays import LONG_FLOW, iterations_needed, score_pose, solve_five
from farpoint._kernels.likelihood import refine_pose
from farpoint._kernels.linear import apply_rotation_step, copy, draw_index, draw_unit
from farpoint._kernels.pairs import RayPairs
from farpoint._kernels.twins import layer_twin, planar_twin
from farpoint._kernels.vectors import combine, dot, rotate, row, vector

__all__ = ["search_direction", "search_pose"]

# A residual beyond three sigma supports no hypothesis.
GATE_SIGMA = 3.0
# Log likelihood to which hypotheses are refined, and by which one is given up that is worse.
COARSE = 0.1
HOPELESS = 30.0
# Shares of wrong and of poor matches that EM starts from.
START_WRONG = 0.2
START_POOR = 0.1


class Pose(NamedTuple):
    """A hypothesis with the noise that it needs."""

    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(3,) variance, share of wrong and share of poor matches."""
    cost: np.ndarray
    """(1,) negative log likelihood."""


class Scratch(NamedTuple):
    """What the refinement writes on the way."""

    prior: np.ndarray
    H: np.ndarray
    r: np.ndarray
    w: np.ndarray
    poor: np.ndarray
    turn: np.ndarray


@kernel
def search_direction(
    pairs: RayPairs,
    candidates: np.ndarray,
    tolerance: float,
    iterations: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
) -> float:
    """Best direction among intersections of two great circles, at a given rotation; its cost.

    The two are drawn from ``candidates`` (M,), indices of the matches that may carry translation.
    """
    limit = tolerance * tolerance
    hypothesis = np.empty(3)
    best = limit * pairs.rays0.shape[0]
    t[0], t[1], t[2] = 0.0, 0.0, 1.0
    for _ in range(iterations):
        i = candidates[draw_index(state, candidates.shape[0])]
        j = candidates[draw_index(state, candidates.shape[0])]
        if i == j or not intersect_circles(pairs, R, i, j, hypothesis):
            continue
        cost = score_pose(pairs, R, hypothesis, limit, best)
        if cost < best:
            best = cost
            copy(hypothesis, t)
    return best


@inner_kernel
def _draw_distinct(sample: np.ndarray, n: int, state: np.ndarray) -> None:
    """Fill ``sample`` with distinct indices below ``n``."""
    for s in range(sample.shape[0]):
        fresh = False
        while not fresh:
            sample[s] = draw_index(state, n)
            fresh = True
            for q in range(s):
                if sample[q] == sample[s]:
                    fresh = False


@inner_kernel
def _flow2(pairs: RayPairs, R: np.ndarray, i: int) -> float:
    """Squared length of the flow that the rotation leaves of match ``i``."""
    flow = combine(1.0, row(pairs.rays1, i), -1.0, rotate(R, row(pairs.rays0, i)))
    return dot(flow, flow)


@inner_kernel
def _longest_flow_first(pairs: RayPairs, R: np.ndarray, sample: np.ndarray) -> None:
    """Bring the two matches with the longest flow after the rotation to the front."""
    for s in range(2):
        longest = -1.0
        first = s
        for q in range(s, sample.shape[0]):
            flow = _flow2(pairs, R, sample[q])
            if flow > longest:
                longest = flow
                first = q
        sample[s], sample[first] = sample[first], sample[s]


@inner_kernel
def _typical_flow(pairs: RayPairs, R: np.ndarray, scratch: np.ndarray) -> float:
    """Median angle, rad, that the rotation ``R`` leaves between matched rays."""
    largest = 0.0
    for i in range(scratch.shape[0]):
        square = _flow2(pairs, R, i)
        scratch[i] = square
        largest = max(largest, square)
    # The median by bisection, which is enough here: np.median takes a second to compile.
    low, high = 0.0, largest
    for _ in range(16):
        middle = 0.5 * (low + high)
        below = 0
        for i in range(scratch.shape[0]):
            below += 1 if scratch[i] <= middle else 0
        if 2 * below < scratch.shape[0]:
            low = middle
        else:
            high = middle
    return math.sqrt(high)


@inner_kernel
def _refine(
    pairs: RayPairs,
    spread: float,
    min_variance: float,
    far_sigma: float,
    steps: int,
    pose: Pose,
    scratch: Scratch,
) -> None:
    """Improve a pose and judge it by the likelihood of the matches with the noise that it needs."""
    pose.cost[0] = refine_pose(
        pairs,
        scratch.prior,
        spread,
        min_variance,
        far_sigma,
        COARSE,
        steps,
        pose.R,
        pose.t,
        pose.mixture,
        scratch.H,
        scratch.r,
        scratch.w,
        scratch.poor,
    )


@inner_kernel
def _face_the_flow(pairs: RayPairs, pose: Pose, scratch: Scratch) -> int:
    """Give the direction the sign towards which more matches flow; returns how many still retreat.

    Matches within the noise have no say. A refinement that knows no sign cannot tell the two, nor a
    pose twisted by half a turn about the direction, which puts each match on the other side of it:
    that one is given up by an infinite cost.
    """
    ahead = 0
    behind = 0
    twisted = 0
    right = 0
    scale = GATE_SIGMA * math.sqrt(pose.mixture[0])
    for i in range(pairs.rays0.shape[0]):
        if scratch.w[i] > 0.5:
            m, b = rotate(pose.R, row(pairs.rays0, i)), row(pairs.rays1, i)
            right += 1
            twisted += 1 if dot(m, b) < dot(m, vector(pose.t)) * dot(b, vector(pose.t)) else 0
            shift = parallax(pairs, pose.R, pose.t, i, scratch.turn)
            ahead += 1 if shift > scale else 0
            behind += 1 if shift < -scale else 0
    if 2 * twisted > right:
        pose.cost[0] = math.inf
    if behind > ahead:
        for k in range(3):
            pose.t[k] = -pose.t[k]
    return min(ahead, behind)


@inner_kernel
def _challenge(
    pairs: RayPairs,
    spread: float,
    min_variance: float,
    steps: int,
    challenger: Pose,
    best: Pose,
    scratch: Scratch,
) -> bool:
    """Refine a hypothesis, first of either sign and then of its own; keep it if it is the best."""
    _refine(pairs, spread, min_variance, math.inf, steps, challenger, scratch)
    if not challenger.cost[0] < best.cost[0] + HOPELESS:
        return False
    retreating = _face_the_flow(pairs, challenger, scratch)
    if retreating > 0 and challenger.cost[0] < math.inf:
        _refine(pairs, spread, min_variance, GATE_SIGMA, steps, challenger, scratch)
    if not challenger.cost[0] < best.cost[0]:
        return False
    copy(challenger.R, best.R)
    copy(challenger.t, best.t)
    copy(challenger.mixture, best.mixture)
    copy(challenger.cost, best.cost)
    return True


@kernel
def search_pose(
    pairs: RayPairs,
    tolerance: float,
    spread: float,
    min_variance: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
    refinements: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
) -> int:
    """Most likely pose among joint five-ray hypotheses and the start ``R, t``; returns iterations.

    Samples are solved in turn from the best pose so far and from the rotation of the start with a
    direction from two of their own rays, which keeps other minima within reach. A hypothesis that
    agrees with more matches than any before it is refined, and judged by its likelihood with the
    noise that it needs: a wrong minimum looks good only with more noise than there is. At last come
    the motions that look like the best one. ``R``, ``t`` and ``mixture`` (3,) receive the best.
    """
    n = pairs.rays0.shape[0]
    scratch = Scratch(
        np.empty(n), np.empty((5, 5)), np.empty(n), np.empty(n), np.empty(n), np.empty(3)
    )
    for i in range(n):
        scratch.prior[i] = 1.0
    best = Pose(R, t, mixture, np.empty(1))
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(1))
    sample = np.empty(5, np.int64)
    start = R.copy()
    flow = _typical_flow(pairs, start, scratch.r)
    mixture[0] = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[1] = START_WRONG
    mixture[2] = START_POOR
    copy(R, other.R)
    copy(t, other.t)
    copy(mixture, other.mixture)
    _refine(pairs, spread, min_variance, GATE_SIGMA, refinements, best, scratch)
    _challenge(pairs, spread, min_variance, refinements, other, best, scratch)
    limit = GATE_SIGMA * GATE_SIGMA * mixture[0]
    lowest = limit * n
    needed = iterations_needed(mixture[1], flow, confidence, min_iterations, max_iterations)
    iteration = 0
    while iteration < needed:
        iteration += 1
        _draw_distinct(sample, n, state)
        if iteration % 2 == 0:
            _step_away(start, flow, state, other.R)
            _longest_flow_first(pairs, other.R, sample)
            if not intersect_circles(pairs, other.R, sample[0], sample[1], other.t):
                continue
        else:
            copy(R, other.R)
            copy(t, other.t)
        if not solve_five(pairs, sample, other.R, other.t):
            continue
        raw = score_pose(pairs, other.R, other.t, limit, lowest)
        if raw >= lowest:
            continue
        lowest = raw
        copy(mixture, other.mixture)
        if _challenge(pairs, spread, min_variance, refinements, other, best, scratch):
            needed = iterations_needed(mixture[1], flow, confidence, min_iterations, max_iterations)
    for twin in range(2):
        if twin == 0:
            found = planar_twin(pairs, R, t, other.R, other.t)
        else:
            found = layer_twin(pairs, R, t, other.R, other.t)
        if found:
            copy(mixture, other.mixture)
            _challenge(pairs, spread, min_variance, refinements, other, best, scratch)
    return iteration


@inner_kernel
def _step_away(start: np.ndarray, flow: float, state: np.ndarray, R: np.ndarray) -> None:
    """The rotation of the start, or one about as far from it as the flow it leaves."""
    if flow < 0.2 * LONG_FLOW:
        copy(start, R)
        return
    x = flow * (2.0 * draw_unit(state) - 1.0)
    y = flow * (2.0 * draw_unit(state) - 1.0)
    z = flow * (2.0 * draw_unit(state) - 1.0)
    apply_rotation_step(start, x, y, z, R)
