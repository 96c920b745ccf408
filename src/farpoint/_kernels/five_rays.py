"""Joint hypotheses: a pose from five matches, how well it fits all, and how many to try."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inlined_kernel, inner_kernel, sum_kernel
from farpoint._kernels.epipolar import flow_along, sampson
from farpoint._kernels.normal_equations import (
    SIX,
    add_six,
    predicted_decrease,
    solve_five_spd,
    write_six,
)
from farpoint._kernels.pairs import LANES, PANEL, address, flow_variance, ray0, ray1
from farpoint._kernels.pose import apply_step
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    cross,
    dot,
    matrix,
    rotate,
    tangent_columns,
    vector,
)

__all__ = ["LONG_FLOW", "SearchBudget", "iterations_needed", "score_pose", "solve_five"]

# Flow after the far rotation, rad, from which on Newton's method starts too far away to be trusted.
LONG_FLOW = 0.05
# How much more rarely a sample converges then: it starts from a rotation of its own.
MAX_RESTART_FACTOR = 2.0
# Probability that the start leads to another pose, with no wrong matches and a short flow.
START_FAILURE = 0.02
# Share of samples without a wrong match that lead to the right pose, where it is hardly in doubt.
CONVERGENCE_RATE = 0.5
# A pose that this share of the matches agrees with has to do with the right one.
MIN_CONSENSUS = 0.4
# Newton's steps: how many, the longest, and one after which the next would be its square.
NEWTON_STEPS = 7
# Pairs that are worked on at once: five, and empty seats.
LANES_OF_FIVE = 8
PADDED_SIZE = 6 * LANES_OF_FIVE
LONGEST_STEP = 0.5
LAST_STEP = 0.01

Row = tuple[float, float, float, float, float, float]


class SearchBudget(NamedTuple):
    """How much is tried to find a pose."""

    tolerance: float
    """Distance at which a match agrees with a first guess, in units of the noise."""
    confidence: float
    """Probability that the pose has been found."""
    min_iterations: int
    """Samples that are drawn in any case."""
    max_iterations: int
    """Samples that are drawn at the most."""


@inlined_kernel
def _cost_each_way(
    pairs: np.ndarray, at: int, R: Matrix, t: Vector, limit: float
) -> tuple[float, float]:
    """Truncated square of a match, and of the same with the other sign of ``t``."""
    r = sampson(pairs, at, R, t)
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, reach2 = flow_along(m, b, t)
    # On opposite sides of t: the pose is twisted by half a turn about it.
    cost = where(dot(m, b) < dot(m, t) * dot(b, t), limit, min(r * r, limit))
    ahead, noise = flow * abs(flow), limit * flow_variance(pairs, at) * reach2
    return where(ahead < -noise, limit, cost), where(ahead > noise, limit, cost)


@sum_kernel
def score_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    limit: float,
    best: float,
) -> float:
    """Truncated squares ``sum min(r^2, limit)`` of all matches, at the better sign of ``t``.

    A match that flows away from ``t`` by more than the limit lies behind the camera, and so does
    one on the other side of ``t``: they cost the full ``limit``. Those of prior 0 cost nothing.
    Returns early, with a cost of at least ``best``, once both signs have lost. ``t`` is flipped in
    place where the other sign is better.
    """
    turn, towards = matrix(R), vector(t)
    forward = backward = 0.0
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            ahead, back = _cost_each_way(pairs, panel * PANEL + lane, turn, towards, limit)
            weight = 1.0 if prior[panel * LANES + lane] > 0.0 else 0.0
            forward += weight * ahead
            backward += weight * back
        if min(forward, backward) >= best:
            return best
    if backward < forward:
        for k in range(3):
            t[k] = -t[k]
        return backward
    return forward


@sum_kernel
def _newton_equations(rays: np.ndarray, R: np.ndarray, t: np.ndarray, normal: np.ndarray) -> None:
    """Normal equations ``normal`` (6, 6) of ``b . (t x m) = 0`` for the pairs ``rays`` (48,).

    Rows ``[m x (b x t), B^T (m x b)]`` are taken at unit length: a short flow gives a weak row, not
    a weak equation.
    """
    turn, towards = matrix(R), vector(t)
    sums = SIX
    for lane in range(LANES_OF_FIVE):
        weight, row = _row(rays, lane, turn, towards)
        sums = add_six(sums, weight, row)
    write_six(sums, normal)


@inlined_kernel
def _row(rays: np.ndarray, lane: int, R: Matrix, t: Vector) -> tuple[float, Row]:
    """Weight and row of the pair in this seat; the last element is the constraint itself."""
    a = rays[lane], rays[LANES_OF_FIVE + lane], rays[2 * LANES_OF_FIVE + lane]
    b = (
        rays[3 * LANES_OF_FIVE + lane],
        rays[4 * LANES_OF_FIVE + lane],
        rays[5 * LANES_OF_FIVE + lane],
    )
    m = rotate(R, a)
    first, second = tangent_columns(t)
    by_t = cross(m, b)
    x, y, z = cross(m, cross(b, t))
    u, v = dot(by_t, first), dot(by_t, second)
    square = x * x + y * y + z * z + u * u + v * v
    return 1.0 / (square + 1e-300), (x, y, z, u, v, dot(t, by_t))


@inner_kernel
def solve_five(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Pose that satisfies the epipolar constraint of five matches, by Newton from ``R, t``.

    Iterative five-point solver on the manifold (Lui and Drummond, BMVC 2013,
    DOI 10.5244/C.27.116). It ends where the next step would be within the noise of five rays; False
    where it does not get there.
    """
    rays, normal, x = np.empty(PADDED_SIZE), np.empty((6, 6)), np.empty(5)
    clear(rays)
    for s in range(5):
        at = address(sample[s])
        for row in range(6):
            rays[row * LANES_OF_FIVE + s] = pairs[at + row * LANES]
    for _ in range(NEWTON_STEPS):
        _newton_equations(rays, R, t, normal)
        if not solve_five_spd(normal, 0.0, x):
            return False
        _, size2 = predicted_decrease(normal, x)
        size = math.sqrt(size2)
        if not size < 1e3:
            return False
        scale = -LONGEST_STEP / size if size > LONGEST_STEP else -1.0
        for k in range(5):
            x[k] *= scale
        apply_step(R, t, x)
        if size < LAST_STEP:
            return True
    return False


@inner_kernel
def iterations_needed(
    outlier_share: float,
    known: float,
    flow: float,
    has_competing_mode: bool,
    budget: SearchBudget,
) -> int:
    """Samples of five until the pose has been found, with the confidence of the ``budget``.

    Half of them are of the share of matches that is ``known`` to agree with a pose that was met: of
    these, as many are right as agree with the best, if those are more than agree by chance.

    The start already led to it, but for a doubt that was measured on drawn and real pairs: it grows
    with the share of ``outlier_share`` matches, and with the square of the ``flow`` that the rotation of
    the start leaves (rad); once there was a rival (``has_competing_mode``), nothing is known. A sample
    without a wrong match converges to the right pose every second time; half as often where that
    flow is long and samples start from their own rotation, and where nothing is known.
    """
    inlier_share = max(1.0 - outlier_share, 0.0)
    square = inlier_share * inlier_share
    away = 1.0 + flow / LONG_FLOW * flow / LONG_FLOW
    start_failure = min(START_FAILURE * away / (square + 1e-9), 1.0)
    failure = 1.0 if has_competing_mode else start_failure
    among_known = min(inlier_share / known, 1.0) * min(inlier_share / MIN_CONSENSUS, 1.0)
    clean = 0.5 * (inlier_share**5 + among_known**5)
    hit = CONVERGENCE_RATE / (1.0 + failure) / min(away, MAX_RESTART_FACTOR) * clean
    if hit <= 0.0:
        return budget.max_iterations
    needed = math.log(min((1.0 - budget.confidence) / failure, 1.0)) / math.log(1.0 - hit)
    least, most = float(budget.min_iterations), float(budget.max_iterations)
    return int(min(max(needed + 1.0, least), most))
