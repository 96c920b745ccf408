"""A hypothesis against the best pose so far: refined, weighed, and kept if it is likelier."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.normal_equations import determinant_beside_one
from farpoint._kernels.pairs import LANES, PANEL, address, ray0, ray1
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose, linearisation_point
from farpoint._kernels.refinement import (
    KEPT,
    PREDICTED_DECREASE,
    advance,
    begin,
    finish,
    refine_pose,
)
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import dot, matrix, rotate, tangent_columns, vector

__all__ = [
    "COARSE_TOLERANCE",
    "GATE_SIGMA",
    "MODE_MARGIN",
    "REFINEMENTS",
    "START_OUTLIER_SHARE",
    "START_TAIL_SHARE",
    "compare_hypothesis",
    "default_noise",
    "initial_noise",
    "is_close_mode",
    "is_same_mode",
    "is_secondary_mode",
    "laplace_factor",
    "mark_consistent",
    "outlier_share_of",
    "planar_margin",
    "refine",
    "refine_if_competitive",
]

# A residual beyond three sigma supports no hypothesis.
GATE_SIGMA = 3.0
# Log likelihood to which hypotheses are refined, and up to which two come near each other.
COARSE_TOLERANCE = 0.1
MODE_MARGIN = 30.0
# What the two motions of a plane differ by at the most, by chance, of so many matches: it grows
# with the root of their number.
PLANAR_MARGIN, PLANAR_MATCHES = 100.0, 160.0
# Cosine of the angle from which on two directions are two motions.
MAX_COSINE = 0.94
# Gain of a refinement over what a step of it promises and the last one gained, at the most.
GAIN_FACTOR = 4.0
# Steps of a refinement. Of a type of its own: for a plain number numba would compile it anew.
REFINEMENTS = np.int64(10)
# Log likelihood within which two hypotheses are taken for one.
SAME_MODE = 2.0
# Matches that agree with a pose by chance: the five of a sample, and one more.
CHANCE_LIMIT = 6.5
# Share of right matches up to which a pose explains none.
MIN_INLIER_SHARE = 0.1
# Shares of wrong, of poor and of repeated matches that EM starts from.
START_OUTLIER_SHARE = 0.2
START_TAIL_SHARE = 0.1
START_REPEATED_SHARE = 0.05


@step_kernel
def laplace_factor(normal: np.ndarray) -> float:
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
    refine_pose(matches, COARSE_TOLERANCE, steps, pose)
    _add_laplace_factor(matches, pose)


@step_kernel
def _add_laplace_factor(matches: PackedMatches, pose: Pose) -> None:
    """Make its cost that of a pose with the room around it: `laplace_factor`.

    One that takes hardly any match for right is no likelier than none, be they repeated about its
    lines.
    """
    pose.cost[0] += laplace_factor(pose.normal)
    if not _has_inliers(pose):
        none = matches.total * math.log(2.0 * matches.outlier_half_width / math.sqrt(2.0 * math.pi))
        pose.cost[0] = max(pose.cost[0], none)


@step_kernel
def _has_inliers(pose: Pose) -> bool:
    """Whether a pose takes more than hardly any match for right."""
    return 1.0 - pose.mixture[1] > MIN_INLIER_SHARE


@step_kernel
def default_noise(tolerance: float, mixture: np.ndarray) -> None:
    """What EM starts from, knowing nothing."""
    mixture[0] = tolerance * tolerance / (GATE_SIGMA * GATE_SIGMA)
    mixture[1] = START_OUTLIER_SHARE
    mixture[2] = START_TAIL_SHARE
    mixture[3] = START_REPEATED_SHARE


@step_kernel
def initial_noise(
    matches: PackedMatches, best: Pose, tolerance: float, mixture: np.ndarray
) -> None:
    """What EM starts from: the noise of the best pose, if it explains more than a sample.

    A wrong minimum calls all matches right and noisy: from so much noise none comes down to another
    one. So it is no more than when nothing is known.
    """
    default_noise(tolerance, mixture)
    explains = (1.0 - best.mixture[1]) * matches.total > CHANCE_LIMIT
    if explains and best.mixture[0] < mixture[0]:
        copy(best.mixture, mixture)


@inner_kernel
def outlier_share_of(matches: PackedMatches, best: Pose, tolerance: float) -> float:
    """Share of matches that the best pose leaves unexplained: by its mixture, or by the tolerance.

    A wrong minimum calls all matches right and noisy: only the tolerance gives it away.
    """
    consistent = np.empty(matches.prior.size)
    clear(consistent)
    mark_consistent(matches.pairs, best.R, best.t, tolerance, consistent)
    within = 0.0
    for i in range(matches.total):
        within += consistent[i]
    return max(best.mixture[1], 1.0 - within / matches.total)


@inner_kernel
def mark_consistent(
    pairs: np.ndarray, R: np.ndarray, t: np.ndarray, tolerance: float, consistent: np.ndarray
) -> None:
    """Write 1 for each match whose residual is within the tolerance; others stay as they are.

    The panels are full, and ``consistent`` has room for what fills them up.
    """
    turn, towards = matrix(R), vector(t)
    for panel in range(consistent.size // LANES):
        for lane in range(LANES):
            i = panel * LANES + lane
            residual = sampson(pairs, panel * PANEL + lane, turn, towards)
            consistent[i] = where(abs(residual) < tolerance, 1.0, consistent[i])


@inner_kernel
def is_same_mode(R: np.ndarray, t: np.ndarray, best: Pose) -> bool:
    """Whether a pose is within the uncertainty of the best: the same minimum, on its way."""
    if not _has_inliers(best) or dot(vector(t), vector(best.t)) < 0.5:
        return False
    trace, distance2 = _apart(R, t, best.R, best.t, best.normal)
    return trace > 2.0 and distance2 < 2.0 * SAME_MODE


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
def refine_if_competitive(
    matches: PackedMatches, pose: Pose, best: Pose, within: float
) -> tuple[bool, bool]:
    """Refine a hypothesis that may compete; whether it does, and whether it was near as it was.

    Near is ``within`` such a log likelihood of the best. Given up as soon as it does not promise to
    come so near, or is seen on its way to the best. A step's promise is a modest one: more matches
    come within reach with it, and that there is less noise gains, too. As much as the last step
    gained, the next one may.
    """
    limit, normal, reached, shares = best.cost[0] + within, pose.normal, pose.cost, np.empty(4)
    point = linearisation_point(matches, pose.R, pose.t, pose.mixture)
    state, kept = np.empty(5), np.empty(KEPT)
    begin(matches, point.mixture, state)
    cost, was_close = math.inf, False
    for step in range(REFINEMENTS):
        before = cost
        goes_on = advance(matches, point, COARSE_TOLERANCE, normal, reached, shares, state, kept)
        cost = reached[0] + laplace_factor(normal)
        if step == 0:
            before, was_close = cost, cost < limit
        gain_bound = GAIN_FACTOR * state[PREDICTED_DECREASE] + before - cost
        if not cost - gain_bound < limit or is_same_mode(point.R, point.t, best):
            return False, was_close
        if not goes_on:
            break
    finish(point.R, point.t, point.mixture, normal, reached, shares, kept)
    _add_laplace_factor(matches, pose)
    return pose.cost[0] < limit and not is_same_mode(pose.R, pose.t, best), was_close


@inner_kernel
def compare_hypothesis(
    matches: PackedMatches,
    hypothesis: Pose,
    best: Pose,
    close: Pose,
    secondary: Pose,
    within: float,
) -> tuple[bool, bool]:
    """Refine a hypothesis that may compete, and keep it if it is better.

    Returns whether it comes near the best, ``within`` a log likelihood, or is better; and whether
    it came near as it was. ``close`` receives the one that has lost then, if it is better than the
    one before; ``secondary`` too if the two come near each other and their directions do not.
    """
    competes, was_close = refine_if_competitive(matches, hypothesis, best, within)
    if not competes:
        return False, was_close
    if _is_twisted(matches, hypothesis):
        return True, was_close
    is_close = best.cost[0] < hypothesis.cost[0] + MODE_MARGIN and _has_other_direction(
        hypothesis, best
    )
    wins = hypothesis.cost[0] < best.cost[0]
    loser = best if wins else hypothesis
    _keep_better(loser, close)
    if is_close:
        _keep_better(loser, secondary)
    if wins:
        copy_pose(hypothesis, best)
    return True, was_close


@step_kernel
def planar_margin(count: int) -> float:
    """Log likelihood that the two motions of a plane may differ by, of so many matches."""
    return max(MODE_MARGIN, PLANAR_MARGIN * math.sqrt(count / PLANAR_MATCHES))


@step_kernel
def is_close_mode(close: Pose, best: Pose) -> bool:
    """Whether a pose that has lost to an earlier one comes near the best, too, and is another."""
    return close.cost[0] < best.cost[0] + MODE_MARGIN and not is_same_mode(close.R, close.t, best)


@inner_kernel
def is_secondary_mode(secondary: Pose, best: Pose) -> bool:
    """Whether a pose that has lost to an earlier one comes near the best, too, and is elsewhere."""
    return secondary.cost[0] < best.cost[0] + MODE_MARGIN and _has_other_direction(secondary, best)


@step_kernel
def _has_other_direction(pose: Pose, best: Pose) -> bool:
    return dot(vector(pose.t), vector(best.t)) < MAX_COSINE


@step_kernel
def _keep_better(pose: Pose, kept: Pose) -> None:
    if pose.cost[0] < kept.cost[0]:
        copy_pose(pose, kept)
