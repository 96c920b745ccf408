"""A hypothesis against the best pose so far: refined, weighed, and kept if it is likelier."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.pairs import LANES, PANEL, address, ray0, ray1
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose, seen_by
from farpoint._kernels.refinement import (
    KEPT,
    PROMISED,
    advance,
    begin,
    finish,
    refine_pose,
)
from farpoint._kernels.scalars import where
from farpoint._kernels.squares import determinant_beside_one
from farpoint._kernels.vectors import dot, matrix, rotate, tangent_columns, vector

__all__ = [
    "COARSE",
    "GATE_SIGMA",
    "NEAR",
    "REFINEMENTS",
    "START_POOR",
    "START_WRONG",
    "challenge",
    "follow",
    "is_close_second",
    "is_rival",
    "is_same",
    "mark_agreeing",
    "narrowness",
    "near_of_plane",
    "noise_of",
    "refine",
    "start_noise",
    "unexplained",
]

# A residual beyond three sigma supports no hypothesis.
GATE_SIGMA = 3.0
# Log likelihood to which hypotheses are refined, and up to which two come near each other.
COARSE = 0.1
NEAR = 30.0
# What the two motions of a plane differ by at the most, by chance, of so many matches: it grows
# with the root of their number.
NEAR_OF_PLANE, OF_MATCHES = 100.0, 160.0
# Cosine of the angle from which on two directions are two motions.
ELSEWHERE = 0.94
# Gain of a refinement over what a step of it promises and the last one gained, at the most.
PROMISES = 4.0
# Steps of a refinement. Of a type of its own: for a plain number numba would compile it anew.
REFINEMENTS = np.int64(10)
# Log likelihood within which two hypotheses are taken for one.
SAME = 2.0
# Matches that agree with a pose by chance: the five of a sample, and one more.
BY_CHANCE = 6.5
# Share of right matches up to which a pose explains none.
LEAST_RIGHT = 0.1
# Shares of wrong, of poor and of repeated matches that EM starts from.
START_WRONG = 0.2
START_POOR = 0.1
START_REPEATED = 0.05


@step_kernel
def narrowness(normal: np.ndarray) -> float:
    """What the likelihood loses when it is averaged over the poses around its maximum.

    The five matches of a sample fit without any noise, and a sixth joins them by chance: the less
    noise, the likelier they are, but the fewer poses do it (Laplace's method). Nothing is wider
    than a radian.
    """
    determinant, positive = determinant_beside_one(normal)
    return 0.5 * math.log(determinant) if positive else math.inf


@step_kernel
def refine(matches: PackedMatches, steps: int, pose: Pose) -> None:
    """Improve a pose and weigh it."""
    refine_pose(matches, COARSE, steps, pose)
    _weigh(matches, pose)


@step_kernel
def _weigh(matches: PackedMatches, pose: Pose) -> None:
    """Make its cost that of a pose with the room around it: `narrowness`.

    One that takes hardly any match for right is no likelier than none, be they repeated about its
    lines.
    """
    pose.cost[0] += narrowness(pose.normal)
    if not _explains(pose):
        none = matches.total * math.log(2.0 * matches.spread / math.sqrt(2.0 * math.pi))
        pose.cost[0] = max(pose.cost[0], none)


@step_kernel
def _explains(pose: Pose) -> bool:
    """Whether a pose takes more than hardly any match for right."""
    return 1.0 - pose.mixture[1] > LEAST_RIGHT


@step_kernel
def start_noise(tolerance: float, mixture: np.ndarray) -> None:
    """What EM starts from, knowing nothing."""
    mixture[0] = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[1] = START_WRONG
    mixture[2] = START_POOR
    mixture[3] = START_REPEATED


@step_kernel
def noise_of(matches: PackedMatches, best: Pose, tolerance: float, mixture: np.ndarray) -> None:
    """What EM starts from: the noise of the best pose, if it explains more than a sample.

    A wrong minimum calls all matches right and noisy: from so much noise none comes down to another
    one. So it is no more than when nothing is known.
    """
    start_noise(tolerance, mixture)
    explains = (1.0 - best.mixture[1]) * matches.total > BY_CHANCE
    if explains and best.mixture[0] < mixture[0]:
        copy(best.mixture, mixture)


@inner_kernel
def unexplained(matches: PackedMatches, best: Pose, tolerance: float) -> float:
    """Share of matches that the best pose leaves unexplained: by its mixture, or by the tolerance.

    A wrong minimum calls all matches right and noisy: only the tolerance gives it away.
    """
    agreeing = np.empty(matches.prior.size)
    clear(agreeing)
    mark_agreeing(matches.pairs, best.R, best.t, tolerance, agreeing)
    within = 0.0
    for i in range(matches.total):
        within += agreeing[i]
    return max(best.mixture[1], 1.0 - within / matches.total)


@inner_kernel
def mark_agreeing(
    pairs: np.ndarray, R: np.ndarray, t: np.ndarray, tolerance: float, agreeing: np.ndarray
) -> None:
    """Write 1 for each match whose residual is within the tolerance; others stay as they are.

    The panels are full, and ``agreeing`` has room for what fills them up.
    """
    turn, towards = matrix(R), vector(t)
    for panel in range(agreeing.size // LANES):
        for lane in range(LANES):
            i = panel * LANES + lane
            residual = sampson(pairs, panel * PANEL + lane, turn, towards)
            agreeing[i] = where(abs(residual) < tolerance, 1.0, agreeing[i])


@inner_kernel
def is_same(R: np.ndarray, t: np.ndarray, best: Pose) -> bool:
    """Whether a pose is within the uncertainty of the best: the same minimum, on its way."""
    if not _explains(best) or dot(vector(t), vector(best.t)) < 0.5:
        return False
    trace, distance2 = _apart(R, t, best.R, best.t, best.normal)
    return trace > 2.0 and distance2 < 2.0 * SAME


@inlined_kernel
def _apart(
    R: np.ndarray, t: np.ndarray, other_R: np.ndarray, other_t: np.ndarray, normal: np.ndarray
) -> tuple[float, float]:
    """Trace of the rotation between two poses, and their squared distance by normal equations."""
    A, B = matrix(R), matrix(other_R)
    trace = dot(A[0], B[0]) + dot(A[1], B[1]) + dot(A[2], B[2])
    # The rotation between the two is small: half the difference of its off-diagonal elements.
    first, second = tangent_columns(vector(other_t))
    x = (
        0.5 * (dot(A[2], B[1]) - dot(A[1], B[2])),
        0.5 * (dot(A[0], B[2]) - dot(A[2], B[0])),
        0.5 * (dot(A[1], B[0]) - dot(A[0], B[1])),
        dot(first, vector(t)),
        dot(second, vector(t)),
    )
    distance2 = 0.0
    for k in range(5):
        for j in range(5):
            distance2 = distance2 + x[k] * normal[k, j] * x[j]
    return trace, distance2


@step_kernel
def _is_twisted(matches: PackedMatches, pose: Pose) -> bool:
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


@step_kernel
def follow(matches: PackedMatches, pose: Pose, best: Pose, within: float) -> tuple[bool, bool]:
    """Refine a hypothesis that may compete; whether it does, and whether it was near as it was.

    Near is ``within`` such a log likelihood of the best. Given up as soon as it does not promise to
    come so near, or is seen on its way to the best. A step's promise is a modest one: more matches
    come within reach with it, and that there is less noise gains, too. As much as the last step
    gained, the next one may.
    """
    enough, normal, reached, shares = best.cost[0] + within, pose.normal, pose.cost, np.empty(4)
    seen = seen_by(matches, pose.R, pose.t, pose.mixture)
    state, kept = np.empty(5), np.empty(KEPT)
    begin(matches, seen.mixture, state)
    cost, was_near = math.inf, False
    for step in range(REFINEMENTS):
        before = cost
        goes_on = advance(matches, seen, COARSE, normal, reached, shares, state, kept)
        cost = reached[0] + narrowness(normal)
        if step == 0:
            before, was_near = cost, cost < enough
        hoped_for = PROMISES * state[PROMISED] + before - cost
        if not cost - hoped_for < enough or is_same(seen.R, seen.t, best):
            return False, was_near
        if not goes_on:
            break
    finish(seen.R, seen.t, seen.mixture, normal, reached, shares, kept)
    _weigh(matches, pose)
    return pose.cost[0] < enough and not is_same(pose.R, pose.t, best), was_near


@inner_kernel
def challenge(
    matches: PackedMatches, challenger: Pose, best: Pose, second: Pose, rival: Pose, within: float
) -> tuple[bool, bool]:
    """Refine a hypothesis that may compete, and keep it if it is better.

    Returns whether it comes near the best, ``within`` a log likelihood, or is better; and whether
    it came near as it was. ``second`` receives the one that has lost then, if it is better than the
    one before; ``rival`` too if the two come near each other and their directions do not.
    """
    competes, was_near = follow(matches, challenger, best, within)
    if not competes:
        return False, was_near
    if _is_twisted(matches, challenger):
        return True, was_near
    is_equal = best.cost[0] < challenger.cost[0] + NEAR and _is_elsewhere(challenger, best)
    wins = challenger.cost[0] < best.cost[0]
    loser = best if wins else challenger
    _keep_better(loser, second)
    if is_equal:
        _keep_better(loser, rival)
    if wins:
        copy_pose(challenger, best)
    return True, was_near


@step_kernel
def near_of_plane(count: int) -> float:
    """Log likelihood that the two motions of a plane may differ by, of so many matches."""
    return max(NEAR, NEAR_OF_PLANE * math.sqrt(count / OF_MATCHES))


@step_kernel
def is_close_second(second: Pose, best: Pose) -> bool:
    """Whether a pose that has lost to an earlier one comes near the best, too, and is another."""
    return second.cost[0] < best.cost[0] + NEAR and not is_same(second.R, second.t, best)


@inner_kernel
def is_rival(rival: Pose, best: Pose) -> bool:
    """Whether a pose that has lost to an earlier one comes near the best, too, and is elsewhere."""
    return rival.cost[0] < best.cost[0] + NEAR and _is_elsewhere(rival, best)


@step_kernel
def _is_elsewhere(pose: Pose, best: Pose) -> bool:
    return dot(vector(pose.t), vector(best.t)) < ELSEWHERE


@step_kernel
def _keep_better(pose: Pose, kept: Pose) -> None:
    if pose.cost[0] < kept.cost[0]:
        copy_pose(pose, kept)
