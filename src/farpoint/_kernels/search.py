"""Search for the pose: directions at a known rotation, then joint hypotheses against the best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.five_rays import LONG_FLOW, iterations_needed, score_pose, solve_five
from farpoint._kernels.formulas import formula, greater, lesser
from farpoint._kernels.likelihood import clutter_density, linearize, mixture_cost, refine_pose
from farpoint._kernels.linear import (
    apply_rotation_step,
    copy,
    draw_direction,
    draw_index,
    draw_unit,
)
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.plausible import largest
from farpoint._kernels.scratch import index_scratch, scratch
from farpoint._kernels.squares import determinant_beside_one, promise, solve_five_spd
from farpoint._kernels.twins import layer_twin, planar_twin
from farpoint._kernels.vectors import combine, dot, matrix, rotate, tangent_columns, vector

__all__ = ["search_direction", "search_pose"]

# A residual beyond three sigma supports no hypothesis.
GATE_SIGMA = 3.0
# Log likelihood to which hypotheses are refined, and up to which a worse one is a rival.
COARSE = 0.1
RIVAL = 30.0
# Gain of a refinement over what its first step promises, at the most.
PROMISES = 4.0
# Steps of a refinement. Of a type of its own: for a plain number numba would compile it anew.
REFINEMENTS = np.int64(10)
# Those after which most hypotheses that lead to the best pose are seen to do so.
GLANCE = np.int64(3)
# Truncated squares over the least so far with which a hypothesis is still worth refining.
PROMISING = 2.0
# Log likelihood within which two hypotheses are taken for one.
SAME = 2.0
# Pairs of matches whose directions the search starts from.
DIRECTIONS = np.int64(16)
# Matches that agree with a pose by chance: the five of a sample, and one more.
BY_CHANCE = 6.5
# Shares of wrong and of poor matches that EM starts from.
START_WRONG = 0.2
START_POOR = 0.1


class Matches(NamedTuple):
    """What a hypothesis is judged by."""

    pairs: np.ndarray
    """Panels of matches."""
    prior: np.ndarray
    """1 for each match, 0 for those that fill up the panels."""
    total: int
    """Matches."""
    spread: float
    """Half the width that wrong matches fill, in units of the noise."""
    min_variance: float
    """Smaller noise is rounding."""


class Pose(NamedTuple):
    """A hypothesis with the noise that it needs."""

    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(3,) variance, share of wrong and share of poor matches."""
    normal: np.ndarray
    """(6, 6) normal equations."""
    cost: np.ndarray
    """(1,) negative log likelihood, of all poses nearby together."""


@kernel
def search_direction(
    pairs: np.ndarray,
    prior: np.ndarray,
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
    hypothesis = scratch(3)
    best = limit * prior.shape[0]
    t[0], t[1], t[2] = 0.0, 0.0, 1.0
    for _ in range(iterations):
        i = candidates[draw_index(state, candidates.shape[0])]
        j = candidates[draw_index(state, candidates.shape[0])]
        if i == j or not intersect_circles(pairs, R, i, j, hypothesis):
            continue
        cost = score_pose(pairs, prior, R, hypothesis, limit, best)
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


@formula
def _flow2(pairs: np.ndarray, R: np.ndarray, i: int) -> float:
    """Squared length of the flow that the rotation leaves of match ``i``."""
    at = address(i)
    flow = combine(1.0, ray1(pairs, at), -1.0, rotate(matrix(R), ray0(pairs, at)))
    return dot(flow, flow)


@inner_kernel
def _longest_flow_first(pairs: np.ndarray, R: np.ndarray, sample: np.ndarray) -> None:
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
def _typical_flow(pairs: np.ndarray, count: int, R: np.ndarray) -> float:
    """Median angle, rad, that the rotation ``R`` leaves between matched rays."""
    squares = np.empty(count)
    for i in range(count):
        squares[i] = _flow2(pairs, R, i)
    return math.sqrt(largest(squares, count // 2 + 1))


@inner_kernel
def _narrowness(normal: np.ndarray) -> float:
    """What the likelihood loses when it is averaged over the poses around its maximum.

    The five matches of a sample fit without any noise, and a sixth joins them by chance: the less
    noise, the likelier they are, but the fewer poses do it (Laplace's method). Nothing is wider
    than a radian.
    """
    determinant, positive = determinant_beside_one(normal)
    return 0.5 * math.log(determinant) if positive else math.inf


@inner_kernel
def _refine(matches: Matches, steps: int, pose: Pose) -> None:
    """Improve a pose and judge it by the likelihood of the matches with the noise that it needs."""
    pose.cost[0] = refine_pose(
        matches.pairs,
        matches.prior,
        matches.total,
        matches.spread,
        matches.min_variance,
        COARSE,
        steps,
        pose.R,
        pose.t,
        pose.mixture,
        pose.normal,
    )
    pose.cost[0] += _narrowness(pose.normal)


@inner_kernel
def _start_noise(tolerance: float, mixture: np.ndarray) -> None:
    """What EM starts from, knowing nothing."""
    mixture[0] = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[1] = START_WRONG
    mixture[2] = START_POOR


@inner_kernel
def _noise_of(matches: Matches, best: Pose, tolerance: float, mixture: np.ndarray) -> None:
    """What EM starts from: the noise of the best pose, if it explains more than a sample."""
    if (1.0 - best.mixture[1]) * matches.total > BY_CHANCE:
        copy(best.mixture, mixture)
    else:
        _start_noise(tolerance, mixture)


@inner_kernel
def _unexplained(matches: Matches, best: Pose, tolerance: float) -> float:
    """Share of matches that the best pose leaves unexplained: by its mixture, or by the tolerance.

    A wrong minimum calls all matches right and noisy: only the tolerance gives it away.
    """
    turn, towards = matrix(best.R), vector(best.t)
    within = 0
    for i in range(matches.total):
        within += 1 if abs(sampson(matches.pairs, address(i), turn, towards)) < tolerance else 0
    return greater(best.mixture[1], 1.0 - within / matches.total)


@inner_kernel
def _is_same(pose: Pose, best: Pose) -> bool:
    """Whether a pose is within the uncertainty of the best: the same minimum, on its way."""
    if pose.t[0] * best.t[0] + pose.t[1] * best.t[1] + pose.t[2] * best.t[2] < 0.5:
        return False
    trace, distance2 = _apart(pose.R, pose.t, best.R, best.t, best.normal)
    return trace > 2.0 and distance2 < 2.0 * SAME


@formula
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, normal: np.ndarray
) -> tuple[float, float]:
    """Trace of the rotation between two poses, and their squared distance by normal equations."""
    A, B = matrix(R), matrix(other_R)
    trace = dot(A[0], B[0]) + dot(A[1], B[1]) + dot(A[2], B[2])
    # The rotation between the two is small: half the difference of its off-diagonal elements.
    x = [0.5 * (dot(A[j], B[i]) - dot(A[i], B[j])) for i, j in ((1, 2), (2, 0), (0, 1))]
    x += [dot(e, vector(t)) for e in tangent_columns(vector(other_t))]
    distance2 = 0.0
    for k in range(5):
        for j in range(5):
            distance2 = distance2 + x[k] * normal[k, j] * x[j]
    return trace, distance2


@inner_kernel
def _is_twisted(matches: Matches, pose: Pose) -> bool:
    """Whether most matches lie on the other side of the direction: a half turn about it too much.

    The epipolar constraint cannot tell the two.
    """
    turn, towards = matrix(pose.R), vector(pose.t)
    twisted = 0
    for i in range(matches.total):
        at = address(i)
        m, b = rotate(turn, ray0(matches.pairs, at)), ray1(matches.pairs, at)
        twisted += 1 if dot(m, b) < dot(m, towards) * dot(b, towards) else 0
    return 2 * twisted > matches.total


@inner_kernel
def _may_compete(matches: Matches, challenger: Pose, best: Pose) -> bool:
    """Whether one step promises to bring a hypothesis about as far as the best.

    The first promise is a modest one: with each step more matches come within reach.
    """
    variance, wrong = challenger.mixture[0], challenger.mixture[1]
    clutter = clutter_density(variance, wrong, matches.spread)
    normal, x, shares = challenger.normal, scratch(5), scratch(2)
    cost = linearize(
        matches.pairs,
        matches.prior,
        challenger.R,
        challenger.t,
        challenger.mixture,
        clutter,
        normal,
        shares,
    )
    cost += matches.total * mixture_cost(variance, wrong) + _narrowness(normal)
    if not solve_five_spd(normal, 0.0, x):
        return False
    gain, _ = promise(normal, x)
    return cost - PROMISES * gain < best.cost[0] + RIVAL


@inner_kernel
def _challenge(matches: Matches, challenger: Pose, best: Pose) -> bool:
    """Refine a hypothesis that may compete, and keep it if it is better; whether it was a rival."""
    if not _may_compete(matches, challenger, best):
        return False
    _refine(matches, GLANCE, challenger)
    if _is_same(challenger, best):
        return False
    _refine(matches, REFINEMENTS, challenger)
    if not challenger.cost[0] < best.cost[0] + RIVAL or _is_same(challenger, best):
        return False
    if challenger.cost[0] < best.cost[0] and not _is_twisted(matches, challenger):
        copy(challenger.R, best.R)
        copy(challenger.t, best.t)
        copy(challenger.mixture, best.mixture)
        copy(challenger.normal, best.normal)
        copy(challenger.cost, best.cost)
    return True


@kernel
def search_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    candidates: np.ndarray,
    tolerance: float,
    spread: float,
    min_variance: float,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
    state: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    twins: np.ndarray,
) -> int:
    """Most likely pose near the rotation ``R`` and among joint hypotheses; returns iterations.

    The start is the direction that the flow of the ``candidates`` suggests at ``R``. Samples are
    solved in turn from the best pose, for a better one nearby, and from about the rotation of the
    start with a direction from anywhere, or from two of their own rays. A hypothesis that agrees
    with the matches about as well as the first pose, and as any since, is refined, and judged by
    its likelihood with the noise that it needs: a wrong minimum looks good only with more noise
    than there is. Once there has been a rival, many more are tried. At last come the motions that
    look like the best one. ``R``, ``t`` and ``mixture`` (3,) receive the best, ``twins`` (2,) which
    of the motions that look alike, by a plane and by two layers, were rivals.
    """
    matches = Matches(pairs, prior, count, spread, min_variance)
    best = Pose(R, t, mixture, scratch(6, 6), scratch(1))
    other = Pose(scratch(3, 3), scratch(3), scratch(3), scratch(6, 6), scratch(1))
    sample, start = index_scratch(5), scratch(3, 3)
    copy(R, start)
    flow = _typical_flow(pairs, count, start)
    _start_noise(tolerance, mixture)
    search_direction(pairs, prior, candidates, tolerance, DIRECTIONS, state, R, t)
    _refine(matches, REFINEMENTS, best)
    _noise_of(matches, best, tolerance, other.mixture)
    limit = GATE_SIGMA * GATE_SIGMA * other.mixture[0]
    copy(t, other.t)
    lowest = score_pose(pairs, prior, R, other.t, limit, math.inf)
    wrong = _unexplained(matches, best, tolerance)
    rivals = 0
    iteration = 0
    while iteration < iterations_needed(
        wrong, flow, rivals > 0, confidence, min_iterations, max_iterations
    ):
        iteration += 1
        _draw_distinct(sample, count, state)
        _step_away(start, flow, state, other.R)
        _longest_flow_first(pairs, other.R, sample)
        if iteration % 3 == 0:
            copy(R, other.R)
            copy(t, other.t)
        elif iteration % 3 == 1:
            draw_direction(state, other.t)
        elif not intersect_circles(pairs, other.R, sample[0], sample[1], other.t):
            continue
        if not solve_five(pairs, sample, other.R, other.t):
            continue
        raw = score_pose(pairs, prior, other.R, other.t, limit, PROMISING * lowest)
        if raw >= PROMISING * lowest:
            continue
        lowest = lesser(raw, lowest)
        _noise_of(matches, best, tolerance, other.mixture)
        if _challenge(matches, other, best):
            rivals += 1
            wrong = _unexplained(matches, best, tolerance)
    for twin in range(2):
        twins[twin] = False
        gate = GATE_SIGMA * math.sqrt(mixture[0])
        if twin == 0:
            found = planar_twin(pairs, count, gate, R, t, other.R, other.t)
        else:
            found = layer_twin(pairs, count, gate, R, t, other.R, other.t)
        if found:
            copy(mixture, other.mixture)
            twins[twin] = _challenge(matches, other, best)
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
