"""The likelihood of a pose given matches of which some are wrong."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel, sum_kernel
from farpoint._kernels.epipolar import (
    flow_along,
    parallax_variance,
    sampson,
    sampson_jacobian,
    shift_jacobian,
)
from farpoint._kernels.exponential import lane_log
from farpoint._kernels.mixture import (
    FAR_SIGMA,
    STEEPER,
    clutter_at,
    clutter_of,
    densities,
    mixture_cost,
    retreat2,
    steps_of,
    sum_of,
    trials_of,
    weight_of,
)
from farpoint._kernels.pairs import LANES, PANEL, ray0, ray1
from farpoint._kernels.pose import PackedMatches, Pose, Seen
from farpoint._kernels.scalars import where
from farpoint._kernels.squares import (
    SIX,
    add_six,
    add_to_square,
    write_six,
)
from farpoint._kernels.vectors import Matrix, Vector, matrix, rotate, tangent_columns, vector

__all__ = ["explain", "judge_pose", "linearize"]

# Right matches that retreat by more, in all, that are left alone.
FEW_RETREATING = 0.01
# `mixture.retreat2` beyond which no match is good.
FARTHEST2 = 64.0


@sum_kernel
def linearize(seen: Seen, gives_way: bool, normal: np.ndarray, shares: np.ndarray) -> float:
    """Robust cost of all matches, with its normal equations.

    The cost is ``-sum log(prior (good + poor) + clutter)``. With J the Jacobian (N, 5) of the
    residuals r, ``normal`` (6, 6) receives ``[J r]^T W [J r]``: the Gauss-Newton matrix, the
    gradient in its last column, the squares in its corner. Where the pose ``gives_way`` to them,
    the shifts of matches that retreat are residuals, too. ``shares`` (4,) receives the expected
    number of right matches, how often these are poorer, how often they could have been, and the
    number of repeated ones among the wrong ones.
    """
    pairs, prior, clutter = seen.pairs, seen.prior, clutter_of(seen.mixture, seen.spread)
    turn, towards = matrix(seen.R), vector(seen.t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / seen.mixture[0], seen.mixture[2]
    cost = right = steps = trials = repeated = retreating = 0.0
    sums = SIX
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            row = sampson_jacobian(pairs, at, turn, towards, basis)
            _, _, _, _, _, residual = row
            each = densities(pairs, at, turn, towards, residual, precision, poor, share, seen.tail)
            whole = sum_of(each)
            lost, near = clutter_at(clutter, residual)
            total = whole + lost
            over = 1.0 / total
            used = 1.0 if share > 0.0 else 0.0
            cost -= used * lane_log(total)
            right += whole * over
            steps += steps_of(each) * over
            trials += trials_of(each, seen.tail) * over
            repeated += used * near * over
            retreat = retreat2(pairs, at, turn, towards, precision)
            retreating += where(retreat > 0.0, whole * over, 0.0)
            sums = add_six(sums, precision * weight_of(each) * over, row)
    write_six(sums, normal)
    if gives_way and retreating > FEW_RETREATING:
        _add_retreats(seen, normal)
    shares[0], shares[1], shares[2], shares[3] = right, steps, trials, repeated
    return cost


@inner_kernel
def _add_retreats(seen: Seen, normal: np.ndarray) -> None:
    """Add the matches that retreat to the normal equations of `linearize`, by their shift.

    As far as they are good, and matches are at all: where noise has tails, of two that are far off
    along their lines one retreats, and the other, which could tell of it, does not.
    """
    pairs, prior, clutter = seen.pairs, seen.prior, clutter_of(seen.mixture, seen.spread)
    turn, towards = matrix(seen.R), vector(seen.t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / seen.mixture[0], seen.mixture[2]
    beyond2 = np.empty(prior.size)
    _tell_retreats(pairs, turn, towards, precision, beyond2)
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            if not 0.0 < beyond2[panel * LANES + lane] < FARTHEST2:
                continue
            residual = sampson(pairs, at, turn, towards)
            each = densities(pairs, at, turn, towards, residual, precision, poor, share, seen.tail)
            good, _, _, _ = each
            lost, _ = clutter_at(clutter, residual)
            right = good / (sum_of(each) + lost)
            weight = STEEPER * precision * (1.0 - poor) * (1.0 - poor) * right
            x, y, z, u, v, shift = shift_jacobian(pairs, at, turn, towards, basis)
            beyond = shift + FAR_SIGMA / math.sqrt(precision)
            add_to_square(weight, (x, y, z, u, v, beyond), normal)


@inner_kernel
def _tell_retreats(
    pairs: np.ndarray, R: Matrix, t: Vector, precision: float, beyond2: np.ndarray
) -> None:
    """`mixture.retreat2` of each match."""
    for panel in range(beyond2.size // LANES):
        for lane in range(LANES):
            at = panel * PANEL + lane
            beyond2[panel * LANES + lane] = retreat2(pairs, at, R, t, precision)


@step_kernel
def judge_pose(matches: PackedMatches, pose: Pose, shares: np.ndarray) -> float:
    """The negative log likelihood of a pose, with the rest as of `linearize`."""
    variance, wrong, spread, tail = pose.mixture[0], pose.mixture[1], matches.spread, matches.tail
    seen = Seen(matches.pairs, matches.prior, pose.R, pose.t, pose.mixture, spread, tail)
    cost = linearize(seen, matches.gives_way, pose.normal, shares)
    return cost + matches.total * mixture_cost(variance, wrong)


@inlined_kernel
def _said_of(
    pairs: np.ndarray,
    at: int,
    R: Matrix,
    t: Vector,
    precision: float,
    poor: float,
    prior: float,
    tail: float,
) -> tuple[float, float, float]:
    """Residual and parallax of a match, both for unit noise, and the sum of its `densities`."""
    residual = sampson(pairs, at, R, t)
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    variance = parallax_variance(pairs, at, R, m, t)
    each = densities(pairs, at, R, t, residual, precision, poor, prior, tail)
    return residual, flow / math.sqrt(variance + 1e-300), sum_of(each)


@kernel
def explain(seen: Seen, residual: np.ndarray, parallax: np.ndarray, right: np.ndarray) -> None:
    """What a pose makes of each match.

    ``residual`` receives the Sampson residual, ``parallax`` the signed shift towards the direction
    along the epipolar line in units of its own noise, both for unit noise, and ``right`` the
    probability of being right.
    """
    pairs, prior, clutter = seen.pairs, seen.prior, clutter_of(seen.mixture, seen.spread)
    turn, towards = matrix(seen.R), vector(seen.t)
    precision, poor = 1.0 / seen.mixture[0], seen.mixture[2]
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, i = panel * PANEL + lane, panel * LANES + lane
            residual[i], parallax[i], density = _said_of(
                pairs, at, turn, towards, precision, poor, prior[i], seen.tail
            )
            lost, _ = clutter_at(clutter, residual[i])
            right[i] = density / (density + lost)
