"""Joint hypotheses: a pose from five matches, how well it fits all, and how many to try."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel, sum_kernel
from farpoint._kernels.epipolar import flow_along, sampson
from farpoint._kernels.likelihood import apply_step, fill_row
from farpoint._kernels.linear import clear, solve_five_spd
from farpoint._kernels.pairs import LANES, PANEL, address, flow_variance, ray0, ray1
from farpoint._kernels.vectors import cross, dot, matrix, rotate, tangent_columns, vector

__all__ = ["LONG_FLOW", "iterations_needed", "score_pose", "solve_five"]

# Flow after the far rotation, rad, from which on Newton's method starts too far away to be trusted.
LONG_FLOW = 0.05
# Probability that the start leads to another pose, with no wrong matches and a short flow.
START_DOUBT = 0.02
# Newton's steps: how many, the longest, and one after which the next would be its square.
NEWTON_STEPS = 7
# Pairs that are worked on at once: five, and empty seats.
SEATS = 8
LONGEST_STEP = 0.5
LAST_STEP = 0.01


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
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at = panel * PANEL + lane
            r = sampson(pairs, at, turn, towards)
            m, b = rotate(turn, ray0(pairs, at)), ray1(pairs, at)
            flow, reach2 = flow_along(m, b, towards)
            cost = min(r * r, limit)
            # On opposite sides of t: the pose is twisted by half a turn about it.
            cost = limit if dot(m, b) < dot(m, towards) * dot(b, towards) else cost
            ahead, noise = flow * abs(flow), limit * flow_variance(pairs, at) * reach2
            weight = 1.0 if prior[panel * LANES + lane] > 0.0 else 0.0
            forward += weight * (limit if ahead < -noise else cost)
            backward += weight * (limit if ahead > noise else cost)
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
    first, second = tangent_columns(towards)
    n00 = n10 = n11 = n20 = n21 = n22 = n30 = n31 = n32 = n33 = 0.0
    n40 = n41 = n42 = n43 = n44 = n50 = n51 = n52 = n53 = n54 = 0.0
    for lane in range(SEATS):
        m = rotate(turn, (rays[lane], rays[SEATS + lane], rays[2 * SEATS + lane]))
        b = rays[3 * SEATS + lane], rays[4 * SEATS + lane], rays[5 * SEATS + lane]
        by_t = cross(m, b)
        j0, j1, j2 = cross(m, cross(b, towards))
        j3, j4 = dot(by_t, first), dot(by_t, second)
        e = dot(towards, by_t)
        weight = 1.0 / (j0 * j0 + j1 * j1 + j2 * j2 + j3 * j3 + j4 * j4 + 1e-300)
        w0, w1, w2, w3, w4 = weight * j0, weight * j1, weight * j2, weight * j3, weight * j4
        n00, n10, n20, n30, n40 = (
            n00 + w0 * j0,
            n10 + w0 * j1,
            n20 + w0 * j2,
            n30 + w0 * j3,
            n40 + w0 * j4,
        )
        n11, n21, n31, n41 = n11 + w1 * j1, n21 + w1 * j2, n31 + w1 * j3, n41 + w1 * j4
        n22, n32, n42 = n22 + w2 * j2, n32 + w2 * j3, n42 + w2 * j4
        n33, n43, n44 = n33 + w3 * j3, n43 + w3 * j4, n44 + w4 * j4
        n50, n51, n52, n53, n54 = (
            n50 + w0 * e,
            n51 + w1 * e,
            n52 + w2 * e,
            n53 + w3 * e,
            n54 + w4 * e,
        )
    fill_row(normal[0], n00, n10, n20, n30, n40, n50)
    fill_row(normal[1], n10, n11, n21, n31, n41, n51)
    fill_row(normal[2], n20, n21, n22, n32, n42, n52)
    fill_row(normal[3], n30, n31, n32, n33, n43, n53)
    fill_row(normal[4], n40, n41, n42, n43, n44, n54)


@kernel
def solve_five(pairs: np.ndarray, sample: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Pose that satisfies the epipolar constraint of five matches, by Newton from ``R, t``.

    Iterative five-point solver on the manifold (Lui and Drummond, BMVC 2013,
    DOI 10.5244/C.27.116). It ends where the next step would be within the noise of five rays; False
    where it does not get there.
    """
    rays, normal, g, x = np.empty(6 * SEATS), np.empty((6, 6)), np.empty(5), np.empty(5)
    clear(rays)
    for s in range(5):
        at = address(sample[s])
        for row in range(6):
            rays[row * SEATS + s] = pairs[at + row * LANES]
    for _ in range(NEWTON_STEPS):
        _newton_equations(rays, R, t, normal)
        for k in range(5):
            g[k] = -normal[k, 5]
        if not solve_five_spd(normal, g, 0.0, x):
            return False
        size = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3] + x[4] * x[4])
        if not size < 1e3:
            return False
        if size > LONGEST_STEP:
            for k in range(5):
                x[k] *= LONGEST_STEP / size
        apply_step(R, t, x)
        if size < LAST_STEP:
            return True
    return False


@kernel
def iterations_needed(
    wrong: float,
    flow: float,
    contested: bool,
    confidence: float,
    min_iterations: int,
    max_iterations: int,
) -> int:
    """Samples of five until the pose has been found, with this confidence.

    The start already led to it, but for a doubt that was measured on drawn and real pairs: it grows
    with the share of ``wrong`` matches, and with the square of the ``flow`` that the rotation of
    the start leaves (rad); where another pose has ``contested`` the best, nothing is known. A
    sample without a wrong match converges to the right pose every second time, and ever more rarely
    where that flow is long or the pose in doubt: the start is then far away.
    """
    right = max(1.0 - wrong, 0.0)
    away = 1.0 + (flow / LONG_FLOW) ** 2
    doubt = min(START_DOUBT * away / (right * right + 1e-9), 1.0) if not contested else 1.0
    hit = 0.5 / (1.0 + doubt) / away * right**5
    if hit <= 0.0:
        return max_iterations
    needed = math.log(min((1.0 - confidence) / doubt, 1.0)) / math.log(1.0 - hit)
    return int(min(max(needed + 1.0, min_iterations), max_iterations))
