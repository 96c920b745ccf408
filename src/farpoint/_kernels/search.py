"""Search for the pose: directions at a known rotation, then joint hypotheses against the best."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.ambiguous_motions import bas_relief_motion, second_planar_motion
from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.five_rays import (
    LONG_FLOW,
    SearchBudget,
    iterations_needed,
    score_pose,
    solve_five,
)
from farpoint._kernels.hypothesis_comparison import (
    GATE_SIGMA,
    MODE_MARGIN,
    REFINEMENTS,
    compare_hypothesis,
    default_noise,
    initial_noise,
    is_close_mode,
    is_secondary_mode,
    mark_consistent,
    outlier_share_of,
    planar_margin,
    refine,
)
from farpoint._kernels.linear import (
    add_outer,
    apply_rotation_step,
    draw_direction,
    draw_index,
    draw_unit,
    kabsch,
)
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.parallax_prior import kth_largest
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.vectors import Vector, axpby, dot, matrix, rotate

__all__ = ["search_direction", "search_pose"]

# A hypothesis is still worth refining with so many times the least truncated squares so far, if at
# least this share of the most matches so far support it.
MAX_SCORE_RATIO = 2.0
MIN_SUPPORT = 0.5
# Pairs of matches whose directions the search starts from.
DIRECTIONS = np.int64(16)
# So many known matches have samples of their own.
MIN_KNOWN = 8


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
    hypothesis = np.empty(3)
    best = limit * prior.size
    t[0], t[1], t[2] = 0.0, 0.0, 1.0
    for _ in range(iterations):
        i = candidates[draw_index(state, candidates.size)]
        j = candidates[draw_index(state, candidates.size)]
        if i == j or not intersect_circles(pairs, R, i, j, hypothesis):
            continue
        cost = score_pose(pairs, prior, R, hypothesis, limit, best)
        if cost < best:
            best = cost
            copy(hypothesis, t)
    return best


@inner_kernel
def _draw_distinct(sample: np.ndarray, among: np.ndarray, n: int, state: np.ndarray) -> None:
    """Fill ``sample`` with distinct indices below ``n``, of those that ``among`` is not 0 for."""
    for s in range(sample.size):
        fresh = False
        while not fresh:
            sample[s] = draw_index(state, n)
            fresh = among[sample[s]] > 0.0
            for q in range(s):
                if sample[q] == sample[s]:
                    fresh = False


@inner_kernel
def _mark_known(matches: PackedMatches, pose: Pose, tolerance: float, known: np.ndarray) -> float:
    """Mark the matches that agree with a pose as ``known``; the share of those that are.

    1 where so few are that samples of them would all be alike.
    """
    mark_consistent(matches.pairs, pose.R, pose.t, tolerance, known)
    count = 0
    for i in range(matches.total):
        count += 1 if known[i] > 0.0 else 0
    return count / matches.total if count >= MIN_KNOWN else 1.0


@inlined_kernel
def _flow(pairs: np.ndarray, R: np.ndarray, i: int) -> Vector:
    """The flow that the rotation leaves of match ``i``."""
    at = address(i)
    return axpby(1.0, ray1(pairs, at), -1.0, rotate(matrix(R), ray0(pairs, at)))


@inlined_kernel
def _flow2(pairs: np.ndarray, R: np.ndarray, i: int) -> float:
    """Its squared length."""
    flow = _flow(pairs, R, i)
    return dot(flow, flow)


@inner_kernel
def _longest_flow_first(pairs: np.ndarray, R: np.ndarray, sample: np.ndarray) -> None:
    """Bring the two matches with the longest flow after the rotation to the front."""
    for s in range(2):
        longest = -1.0
        first = s
        for q in range(s, sample.size):
            flow = _flow2(pairs, R, sample[q])
            if flow > longest:
                longest = flow
                first = q
        sample[s], sample[first] = sample[first], sample[s]


@step_kernel
def _typical_flow(pairs: np.ndarray, count: int, R: np.ndarray) -> float:
    """Median angle, rad, that the rotation ``R`` leaves between matched rays."""
    squares = np.empty(count)
    for i in range(count):
        squares[i] = _flow2(pairs, R, i)
    return math.sqrt(kth_largest(squares, count // 2 + 1))


@step_kernel
def search_pose(
    matches: PackedMatches,
    candidates: np.ndarray,
    budget: SearchBudget,
    state: np.ndarray,
    best: Pose,
    close: Pose,
    secondary: Pose,
) -> tuple[int, bool, bool, bool]:
    """Most likely pose near the rotation of ``best`` and among joint hypotheses.

    The start is the direction that the flow of the ``candidates`` suggests there. Samples are
    solved in turn from the best pose, for a better one nearby, and from about the rotation of the
    start, or their own, with a direction from anywhere, or from their own rays. Every second sample
    is drawn from the matches that agree with a pose that was the best or its rival: where a better
    one is found, few of its matches are new, and hardly any wrong one is known. A hypothesis that
    agrees with the matches about as well as the first pose, and as any since, is refined, and
    judged by its likelihood with the noise that it needs: a wrong minimum looks good only with more
    noise than there is. Once there has been a rival, more are tried. At last come the motions that
    look like the best one. ``best`` receives it, ``close`` the next best, ``secondary`` the next best
    of those elsewhere. Returns the number of samples, whether the other motion of a plane was a
    rival, and whether there is a rival and a second that came near the best.
    """
    pairs, prior, count, tolerance = matches.pairs, matches.prior, matches.total, budget.tolerance
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    sample, start = np.empty(5, np.int64), np.empty((3, 3))
    close.cost[0] = secondary.cost[0] = math.inf
    copy(best.R, start)
    flow = _typical_flow(pairs, count, start)
    limit, lowest = _start(matches, candidates, tolerance, state, best, other)
    outlier_share = outlier_share_of(matches, best, tolerance)
    known = np.empty(prior.size)
    clear(known)
    share = _mark_known(matches, best, tolerance, known)
    has_competing_mode = np.bool_(False)  # a plain word has a type of its own
    iteration = 0
    while iteration < iterations_needed(outlier_share, share, flow, has_competing_mode, budget):
        iteration += 1
        are_known = iteration % 2 == 0 and share < 1.0
        _draw_distinct(sample, known if are_known else prior, count, state)
        # From the best pose samples of known matches would lead back to it.
        start_kind = 1 + iteration // 2 % 2 if are_known else iteration // 2 % 3
        if not _solve_sample(pairs, sample, start_kind, start, flow, state, best, other):
            continue
        most = min(
            MAX_SCORE_RATIO * lowest, MIN_SUPPORT * lowest + (1.0 - MIN_SUPPORT) * limit * count
        )
        raw = score_pose(pairs, prior, other.R, other.t, limit, most)
        if raw >= most:
            continue
        lowest = min(raw, lowest)
        initial_noise(matches, best, tolerance, other.mixture)
        # Once others are known, one that is no better than they are tells nothing new.
        worst = max(close.cost[0], secondary.cost[0])
        within = worst - best.cost[0] if worst < best.cost[0] + MODE_MARGIN else MODE_MARGIN
        competes, _ = compare_hypothesis(matches, other, best, close, secondary, within)
        if competes:
            has_competing_mode = np.bool_(True)
            outlier_share = outlier_share_of(matches, best, tolerance)
            _mark_known(matches, best, tolerance, known)
            share = _mark_known(matches, other, tolerance, known)
    is_planar = _search_ambiguous_motions(matches, best, other, close, secondary)
    return iteration, is_planar, is_secondary_mode(secondary, best), is_close_mode(close, best)


@step_kernel
def _start(
    matches: PackedMatches,
    candidates: np.ndarray,
    tolerance: float,
    state: np.ndarray,
    best: Pose,
    other: Pose,
) -> tuple[float, float]:
    """Put ``best`` where, at its rotation, the flow of the ``candidates`` leads.

    Returns the square beyond which no match supports it, and the truncated squares of all matches
    there. ``other`` is room.
    """
    default_noise(tolerance, best.mixture)
    search_direction(
        matches.pairs, matches.prior, candidates, tolerance, DIRECTIONS, state, best.R, best.t
    )
    refine(matches, REFINEMENTS, best)
    initial_noise(matches, best, tolerance, other.mixture)
    limit = GATE_SIGMA * GATE_SIGMA * other.mixture[0]
    copy(best.t, other.t)
    return limit, score_pose(matches.pairs, matches.prior, best.R, other.t, limit, math.inf)


@step_kernel
def _search_ambiguous_motions(
    matches: PackedMatches, best: Pose, other: Pose, close: Pose, secondary: Pose
) -> bool:
    """Challenge the best pose by those that look like it; whether a plane's was a rival."""
    gate = GATE_SIGMA * math.sqrt(best.mixture[0])
    is_planar = second_planar_motion(
        matches.pairs, matches.total, gate, best.R, best.t, other.R, other.t
    )
    if is_planar:
        copy(best.mixture, other.mixture)
        # The best may lie between the two: it goes to one of them when it is refined.
        within = planar_margin(matches.total)
        competes, was_close = compare_hypothesis(matches, other, best, close, secondary, within)
        is_planar = competes or was_close
        gate = GATE_SIGMA * math.sqrt(best.mixture[0])
    if bas_relief_motion(matches.pairs, matches.total, gate, best.R, best.t, other.R, other.t):
        copy(best.mixture, other.mixture)
        compare_hypothesis(matches, other, best, close, secondary, MODE_MARGIN)
    return is_planar


@inner_kernel
def _solve_sample(
    pairs: np.ndarray,
    sample: np.ndarray,
    start_kind: int,
    start: np.ndarray,
    flow: float,
    state: np.ndarray,
    best: Pose,
    other: Pose,
) -> bool:
    """Solve a sample from where it is the ``start_kind`` to, of three, for the pose ``other``.

    From the best pose; or from about the rotation of the start with a direction from anywhere, or
    from the two rays that flow most. Where the start leaves a long flow, it may be any rotation:
    then from that which turns the sample's own rays nearest to each other, in the direction in
    which one of them flows most. False where there is no such place, or no solution near it.
    """
    if start_kind == 0:
        copy(best.R, other.R)
        copy(best.t, other.t)
    elif flow > LONG_FLOW and _turn_of_sample(pairs, sample, other.R):
        _longest_flow_first(pairs, other.R, sample)
        _along_flow(pairs, sample[0], other.R, other.t)
    else:
        _step_away(start, flow, state, other.R)
        _longest_flow_first(pairs, other.R, sample)
        if start_kind == 1:
            draw_direction(state, other.t)
        elif not intersect_circles(pairs, other.R, sample[0], sample[1], other.t):
            return False
    return solve_five(pairs, sample, other.R, other.t)


@step_kernel
def _turn_of_sample(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray) -> bool:
    """The rotation that brings the rays of a sample nearest to each other, if there is one."""
    M = np.empty((3, 3))
    clear(M)
    for s in range(sample.size):
        at = address(sample[s])
        add_outer(ray1(pairs, at), ray0(pairs, at), 1.0, M)
    return kabsch(M, R)


@step_kernel
def _along_flow(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> None:
    """The direction ``t`` in which the rotation leaves match ``i`` to flow."""
    x, y, z = _flow(pairs, R, i)
    over = 1.0 / math.sqrt(x * x + y * y + z * z + 1e-300)
    t[0], t[1], t[2] = x * over, y * over, z * over


@step_kernel
def _step_away(start: np.ndarray, flow: float, state: np.ndarray, R: np.ndarray) -> None:
    """The rotation of the start, or one about as far from it as the flow it leaves."""
    if flow < 0.2 * LONG_FLOW:
        copy(start, R)
        return
    x = flow * (2.0 * draw_unit(state) - 1.0)
    y = flow * (2.0 * draw_unit(state) - 1.0)
    z = flow * (2.0 * draw_unit(state) - 1.0)
    apply_rotation_step(start, x, y, z, R)
