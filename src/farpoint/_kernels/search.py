"""Search for the pose: directions at a known rotation, then five-ray hypotheses."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.ambiguous_motions import bas_relief_motion, second_planar_motion
from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    COARSE_STEPS,
    GATE_SIGMA,
    INITIAL_PAIRS,
    LONG_FLOW_RAD,
    MAX_SCORE_RATIO,
    MIN_MATCHES,
    MIN_SUPPORT_RATIO,
    MODE_MARGIN,
)
from farpoint._kernels.direction import intersect_circles
from farpoint._kernels.five_rays import SearchBudget, iterations_needed, score_pose, solve_five
from farpoint._kernels.hypothesis_comparison import (
    compare_hypothesis,
    default_noise,
    initial_noise,
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
    """Best direction among intersections of two great circles at a given rotation.

    The pairs of matches are drawn from ``candidates`` (M,), the indices of matches that may show
    translation. The function returns the cost of the direction.
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
    """Fill ``sample`` with distinct indices below ``n`` whose ``among`` is not 0."""
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
    """Mark the matches consistent with a pose as ``known``; returns the share of known matches.

    If fewer than `MIN_MATCHES` are known, the function returns 1, and samples are drawn from all
    matches, because samples of so few matches would hardly differ.
    """
    mark_consistent(matches.pairs, pose.R, pose.t, tolerance, known)
    count = 0
    for i in range(matches.total):
        count += 1 if known[i] > 0.0 else 0
    return count / matches.total if count >= MIN_MATCHES else 1.0


@inlined_kernel
def _flow(pairs: np.ndarray, R: np.ndarray, i: int) -> Vector:
    """Flow ``b - R a`` of match ``i``."""
    at = address(i)
    return axpby(1.0, ray1(pairs, at), -1.0, rotate(matrix(R), ray0(pairs, at)))


@inlined_kernel
def _flow2(pairs: np.ndarray, R: np.ndarray, i: int) -> float:
    """Squared length of the flow of match ``i`` after the rotation."""
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
    """Median angle, rad, between matched rays after the rotation ``R``."""
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
    secondary: Pose,
) -> tuple[int, bool, bool]:
    """Likeliest pose near the rotation of ``best`` and among five-ray hypotheses.

    The search starts at the rotation of ``best``, and at the direction on which the flow of the
    ``candidates`` agrees (`search_direction`). Samples of five matches are solved in turn from
    three starts (`_solve_sample`): the best pose; a rotation with a random direction; a rotation
    with the intersection of two great circles of the sample. Every second sample is drawn from
    matches consistent with the best pose or a competing mode, because few of these matches are
    outliers. A hypothesis is refined, and compared by its likelihood, if the truncated sum of
    squared residuals is low enough (`MAX_SCORE_RATIO`, `MIN_SUPPORT_RATIO`). Each hypothesis has
    separate noise parameters: at a wrong mode, the ratio of squared residuals to variance is low
    only with a larger variance, which lowers the likelihood. After a competing mode was found, more
    samples are drawn. Finally the best pose is compared with its ambiguous motions.

    ``best`` receives the likeliest pose, and ``secondary`` the likeliest pose in another direction.
    The function returns the number of samples, whether the second motion of a plane competes, and
    whether ``secondary`` is within `MODE_MARGIN` of ``best``.
    """
    pairs, prior, count, tolerance = matches.pairs, matches.prior, matches.total, budget.tolerance
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    sample, start = np.empty(5, np.int64), np.empty((3, 3))
    secondary.cost[0] = math.inf
    copy(best.R, start)
    flow = _typical_flow(pairs, count, start)
    limit, lowest = _start(matches, candidates, tolerance, state, best, other)
    outlier_share = outlier_share_of(matches, best, tolerance)
    known = np.empty(prior.size)
    clear(known)
    share = _mark_known(matches, best, tolerance, known)
    has_competing_mode = np.bool_(False)  # a literal would be of another numba type
    iteration = 0
    while iteration < iterations_needed(outlier_share, share, flow, has_competing_mode, budget):
        iteration += 1
        are_known = iteration % 2 == 0 and share < 1.0
        _draw_distinct(sample, known if are_known else prior, count, state)
        # A sample of consistent matches does not start from the best pose, because its solution
        # would be the best pose again.
        start_kind = 1 + iteration // 2 % 2 if are_known else iteration // 2 % 3
        if not _solve_sample(pairs, sample, start_kind, start, flow, state, best, other):
            continue
        most = min(
            MAX_SCORE_RATIO * lowest,
            MIN_SUPPORT_RATIO * lowest + (1.0 - MIN_SUPPORT_RATIO) * limit * count,
        )
        raw = score_pose(pairs, prior, other.R, other.t, limit, most)
        if raw >= most:
            continue
        lowest = min(raw, lowest)
        initial_noise(matches, best, tolerance, other.mixture)
        # With two modes, a hypothesis less likely than both is of no use.
        worst = secondary.cost[0]
        within = worst - best.cost[0] if worst < best.cost[0] + MODE_MARGIN else MODE_MARGIN
        competes, _ = compare_hypothesis(matches, other, best, secondary, within)
        if competes:
            has_competing_mode = np.bool_(True)
            outlier_share = outlier_share_of(matches, best, tolerance)
            _mark_known(matches, best, tolerance, known)
            share = _mark_known(matches, other, tolerance, known)
    is_planar = _search_ambiguous_motions(matches, best, other, secondary)
    return iteration, is_planar, is_secondary_mode(secondary, best)


@step_kernel
def _start(
    matches: PackedMatches,
    candidates: np.ndarray,
    tolerance: float,
    state: np.ndarray,
    best: Pose,
    other: Pose,
) -> tuple[float, float]:
    """Refine ``best`` from its rotation and the direction of the flow of the ``candidates``.

    The function returns the squared residual beyond which a match does not support a pose, and the
    truncated sum of squares of all matches at the refined pose. ``other`` is a buffer.
    """
    default_noise(tolerance, best.mixture)
    search_direction(
        matches.pairs, matches.prior, candidates, tolerance, INITIAL_PAIRS, state, best.R, best.t
    )
    refine(matches, COARSE_STEPS, best)
    initial_noise(matches, best, tolerance, other.mixture)
    limit = GATE_SIGMA * GATE_SIGMA * other.mixture[0]
    copy(best.t, other.t)
    return limit, score_pose(matches.pairs, matches.prior, best.R, other.t, limit, math.inf)


@step_kernel
def _search_ambiguous_motions(
    matches: PackedMatches, best: Pose, other: Pose, secondary: Pose
) -> bool:
    """Compare the best pose with its ambiguous motions.

    The function returns whether the second motion of a plane competes.
    """
    gate = GATE_SIGMA * math.sqrt(best.mixture[0])
    is_planar = second_planar_motion(
        matches.pairs, matches.total, gate, best.R, best.t, other.R, other.t
    )
    if is_planar:
        copy(best.mixture, other.mixture)
        # The best pose may lie between the two motions of the plane. The refinement of the second
        # motion may then converge to the best pose, so it is also sufficient that the second motion
        # was within the margin before its refinement.
        within = planar_margin(matches.total)
        competes, was_close = compare_hypothesis(matches, other, best, secondary, within)
        is_planar = competes or was_close
        gate = GATE_SIGMA * math.sqrt(best.mixture[0])
    if bas_relief_motion(matches.pairs, matches.total, gate, best.R, best.t, other.R, other.t):
        copy(best.mixture, other.mixture)
        compare_hypothesis(matches, other, best, secondary, MODE_MARGIN)
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
    """Solve a sample from one of three starts (``start_kind`` 0 to 2) for the pose ``other``.

    Kind 0 starts at the best pose. Kind 1 starts at a rotation near the initial rotation, with a
    random direction. Kind 2 starts at the same rotation as kind 1, with the intersection of the
    great circles of the two matches with the longest flow. If the initial rotation leaves a long
    flow, kinds 1 and 2 start at the rotation that aligns the rays of the sample (Kabsch), with the
    direction of the longest flow in the sample. The function returns False if there is no start or
    no solution.
    """
    if start_kind == 0:
        copy(best.R, other.R)
        copy(best.t, other.t)
    elif flow > LONG_FLOW_RAD and _aligning_rotation(pairs, sample, other.R):
        _longest_flow_first(pairs, other.R, sample)
        _direction_of_flow(pairs, sample[0], other.R, other.t)
    else:
        _nearby_rotation(start, flow, state, other.R)
        _longest_flow_first(pairs, other.R, sample)
        if start_kind == 1:
            draw_direction(state, other.t)
        elif not intersect_circles(pairs, other.R, sample[0], sample[1], other.t):
            return False
    return solve_five(pairs, sample, other.R, other.t)


@step_kernel
def _aligning_rotation(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray) -> bool:
    """Rotation that aligns the rays of a sample (Kabsch); False if it is not unique."""
    M = np.empty((3, 3))
    clear(M)
    for s in range(sample.size):
        at = address(sample[s])
        add_outer(ray1(pairs, at), ray0(pairs, at), 1.0, M)
    return kabsch(M, R)


@step_kernel
def _direction_of_flow(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> None:
    """Direction ``t`` of the flow of match ``i`` after the rotation."""
    x, y, z = _flow(pairs, R, i)
    over = 1.0 / math.sqrt(x * x + y * y + z * z + 1e-300)
    t[0], t[1], t[2] = x * over, y * over, z * over


@step_kernel
def _nearby_rotation(start: np.ndarray, flow: float, state: np.ndarray, R: np.ndarray) -> None:
    """Write a random rotation near the initial rotation ``start`` to ``R``.

    Each coordinate of the rotation vector from ``start`` to ``R`` is uniform between ``-flow`` and
    ``flow``, the flow that the initial rotation leaves, rad. If ``flow`` is below 0.2 times
    `LONG_FLOW_RAD`, ``R`` is the initial rotation itself.
    """
    if flow < 0.2 * LONG_FLOW_RAD:
        copy(start, R)
        return
    x = flow * (2.0 * draw_unit(state) - 1.0)
    y = flow * (2.0 * draw_unit(state) - 1.0)
    z = flow * (2.0 * draw_unit(state) - 1.0)
    apply_rotation_step(start, x, y, z, R)
