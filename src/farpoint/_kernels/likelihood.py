"""The likelihood of a pose given matches of which some are wrong, and its maximum.

A match is good, with a normal residual of variance ``variance``; or poor, with `POOR` times its
sigma; or wrong, and anywhere in a strip of half-width ``spread`` about the epipolar line (all in
units of the noise). Of the poor ones, as large a share is poorer still, with `POOR` times their
sigma: the tails of real matches go on like this. The shares of poor matches among the right ones
and of wrong ones among all are estimated along, so that normal noise is treated as such and heavy
tails lose only what they must.

A right match flows towards the direction. Noise can make a far one retreat; beyond `FAR_SIGMA` the
density of right matches falls off as that noise does. Up to there it is flat, for rotation can
imitate parallax, and any slope would pull at the rotation.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, sum_kernel
from farpoint._kernels.epipolar import (
    flow_along,
    parallax_variance,
    sampson,
    sampson_jacobian,
    shift_jacobian,
)
from farpoint._kernels.exponential import exp_and_roots, lane_log
from farpoint._kernels.formulas import choose, formula, greater, lesser, root
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.pairs import LANES, PANEL, address, flow_variance, ray0, ray1
from farpoint._kernels.scratch import copy, scratch
from farpoint._kernels.squares import (
    SIX,
    add_square,
    add_to_square,
    promise,
    solve_five_spd,
    write_square,
)
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    combine,
    dot,
    matrix,
    rotate,
    tangent_columns,
    vector,
)

__all__ = [
    "FAR_SIGMA",
    "POOR",
    "add_retreats",
    "apply_step",
    "clutter_density",
    "densities",
    "explain",
    "linearize",
    "mean_variance",
    "mixture_cost",
    "refine_pose",
    "take_step",
    "update_mixture",
    "weight_of",
]

# Sigma of a poor match over that of a good one.
POOR = math.sqrt(8.0)
# Share of poor matches that is usual, with the weight of so many matches: among few, chance alone
# makes some look poor, and the others better than they are.
FEW_POOR = 0.01
USUAL = 20.0
# How much farther than EM a step of the mixture goes, by the share of poor matches, and at most.
FARTHER = 3.0
MOST_FARTHER = 0.7
# Retreat along its epipolar line that noise can cause of a far point, in sigma.
FAR_SIGMA = 3.0
# Variance of a flow in one direction over the mean of all, at the least.
LEAST_SHARE = 0.1
# Right matches that retreat by more, in all, that are left alone.
FEW_RETREATING = 0.01


@kernel
def apply_step(R: np.ndarray, t: np.ndarray, x: np.ndarray) -> None:
    """Move the pose by ``x = [dtheta (3), dbeta (2)]`` in place."""
    apply_rotation_step(R, x[0], x[1], x[2], R)
    _apply_direction_step(t, x[3], x[4])


@inner_kernel
def take_step(R: np.ndarray, t: np.ndarray, x: np.ndarray, size2: float) -> None:
    """Move the pose against ``x``, of this squared length, by 0.3 at the most."""
    scale = -1.0 if size2 < 0.09 else -0.3 / math.sqrt(size2)
    for k in range(5):
        x[k] *= scale
    apply_step(R, t, x)


@formula
def _apply_direction_step(t: np.ndarray, x: float, y: float) -> None:
    first, second = tangent_columns(vector(t))
    moved = combine(1.0, vector(t), 1.0, combine(x, first, y, second))
    scale = 1.0 / root(dot(moved, moved))
    t[0], t[1], t[2] = scale * moved[0], scale * moved[1], scale * moved[2]


@formula
def clutter_density(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of inliers at r = 0."""
    return wrong / (1.0 - wrong) * root(2.0 * math.pi * variance) / (2.0 * spread)


@formula
def mean_variance(variance: float, poor: float) -> float:
    """Of right matches, good and poor."""
    good, eightfold = 1.0 - poor, poor * POOR * POOR
    return variance * (good + eightfold * (good + eightfold))


@inner_kernel
def _unusual(poor: float) -> float:
    """Cost of a share of poor matches that is not the usual one."""
    return -USUAL * (FEW_POOR * math.log(poor) + (1.0 - FEW_POOR) * math.log(1.0 - poor))


@inner_kernel
def mixture_cost(variance: float, wrong: float) -> float:
    """What each match adds to the cost by the noise alone."""
    return 0.5 * math.log(variance) - math.log(1.0 - wrong)


@formula
def densities(
    pairs: np.ndarray,
    at: int,
    R: tuple,
    t: tuple,
    residual: float,
    precision: float,
    poor: float,
    prior: float,
) -> tuple[float, float, float]:
    """Density of the match at this address, if good, poor or poorer, over a good one's at 0."""
    retreat = _retreat(pairs, at, R, t, precision)
    whole, eighth, last = exp_and_roots(0.5 * (residual * residual * precision + retreat))
    once, again = 1.0 - poor, poor / POOR
    return (
        prior * (once * whole),
        prior * (once * again * eighth),
        prior * (again * again * last),
    )


@formula
def _retreat(pairs: np.ndarray, at: int, R: tuple, t: tuple, precision: float) -> float:
    """How much farther away from the direction a match lies than noise may bring it, squared."""
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    shift2 = flow * flow * precision / (parallax_variance(pairs, at, R, m, t) + 1e-300)
    return choose(flow < 0.0, greater(shift2 - FAR_SIGMA * FAR_SIGMA, 0.0), 0.0)


@formula
def _may_retreat(pairs: np.ndarray, at: int, R: tuple, t: tuple, precision: float) -> bool:
    """Whether `_retreat` is to be asked: it is 0 otherwise, and takes longer."""
    flow, reach2 = flow_along(rotate(R, ray0(pairs, at)), ray1(pairs, at), t)
    least = LEAST_SHARE * FAR_SIGMA * FAR_SIGMA * flow_variance(pairs, at) * reach2
    return (flow < 0.0) & (flow * flow * precision > least)


@formula
def weight_of(good: float, fair: float, bad: float) -> float:
    """Sum of what may be a match's densities, each over its variance in units of a good one's."""
    return good + fair * 0.125 + bad * 0.015625


@sum_kernel
def linearize(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    gives_way: bool,
    normal: np.ndarray,
    shares: np.ndarray,
) -> float:
    """Robust cost of all matches, with its normal equations.

    The cost is ``-sum log(prior (good + poor) + clutter)``, where ``prior`` scales the share of
    right matches one by one (0 leaves a match out) and ``clutter``, positive, is the density of
    wrong matches over that of right ones. With J the Jacobian (N, 5) of the residuals r, ``normal``
    (6, 6) receives ``[J r]^T W [J r]``: the Gauss-Newton matrix, the gradient in its last column,
    the squares in its corner. Where the pose ``gives_way`` to them, the shifts of matches that
    retreat are residuals, too. ``shares`` (3,) receives the expected number of right matches, of
    poor ones among them, and of those that are poorer still.
    """
    turn, towards = matrix(R), vector(t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / mixture[0], mixture[2]
    cost = used = right = doubtful = poorest = retreating = 0.0
    sums = SIX
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            row = sampson_jacobian(pairs, at, turn, towards, basis)
            _, _, _, _, _, residual = row
            good, fair, bad = densities(pairs, at, turn, towards, residual, precision, poor, share)
            total = good + fair + bad + clutter
            over = 1.0 / total
            cost -= lane_log(total)
            used += 1.0 if share > 0.0 else 0.0
            right += (good + fair + bad) * over
            doubtful += (fair + bad) * over
            poorest += bad * over
            retreat = _retreat(pairs, at, turn, towards, precision)
            retreating += choose(retreat > 0.0, (good + fair + bad) * over, 0.0)
            sums = add_square(sums, precision * weight_of(good, fair, bad) * over, row)
    write_square(sums, normal)
    if gives_way and retreating > FEW_RETREATING:
        add_retreats(pairs, prior, R, t, mixture, clutter, normal)
    shares[0], shares[1], shares[2] = right, doubtful, poorest
    return cost + (prior.size - used) * lane_log(clutter)


@inner_kernel
def add_retreats(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    normal: np.ndarray,
) -> None:
    """Add the matches that retreat to the normal equations of `linearize`, by their shift."""
    turn, towards = matrix(R), vector(t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / mixture[0], mixture[2]
    for i in range(prior.size):
        at = address(i)
        if not _may_retreat(pairs, at, turn, towards, precision):
            continue
        if not _retreat(pairs, at, turn, towards, precision) > 0.0:
            continue
        residual = sampson(pairs, at, turn, towards)
        good, fair, bad = densities(pairs, at, turn, towards, residual, precision, poor, prior[i])
        weight = precision * weight_of(good, fair, bad) / (good + fair + bad + clutter)
        row = shift_jacobian(pairs, at, turn, towards, basis)
        add_to_square(weight, row, normal)


@formula
def update_mixture(
    square: float,
    shares: np.ndarray,
    count: float,
    minimum: float,
    haste: float,
    mixture: np.ndarray,
) -> None:
    """Step of EM of variance, share of wrong and share of poor matches, from weighted sums.

    Of the right matches some are poor, and of these as large a share poorer still. With a ``haste``
    of 1 it goes farther than EM does, with 0 it does not.
    """
    total, poor, poorest = shares[0], shares[1], shares[2]
    share = (poor + poorest + FEW_POOR * USUAL) / (total + poor + USUAL)
    # EM goes the right way, and the more slowly the heavier the tails: farther that way helps.
    farther = haste * lesser(FARTHER * mixture[2], MOST_FARTHER)
    change = lesser(greater(farther * (square / mixture[0] - 1.0), -0.5), 1.0)
    mixture[0] = greater((1.0 + change) * square, minimum)
    mixture[1] = lesser(greater(1.0 - total / count, 0.005), 0.95)
    mixture[2] = lesser(greater(share + farther * (share - mixture[2]), 0.5 * share), 0.5)


@kernel
def refine_pose(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    precision: float,
    max_iterations: int,
    gives_way: bool,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
) -> float:
    """Maximum-likelihood pose, with its noise by EM; returns the negative log likelihood.

    Gauss-Newton with the full derivative of the residual, and where the pose ``gives_way`` to
    matches that retreat, of their shifts. Motions that are held against each other do not: each
    match may retreat by `FAR_SIGMA` at no cost, and the reverse of a motion would make use of that.
    ``mixture`` (3,) holds the variance of good matches, the share of wrong ones among all ``count``
    and that of poor ones, in and out. It ends at a pose from which a step promises less than
    ``precision``, in the unit of the log likelihood; ``normal`` (6, 6) receives the normal
    equations there.
    """
    x, shares = scratch(5), scratch(3)
    kept_R, kept_t, kept = scratch(3, 3), scratch(3), scratch(6, 6)
    kept_mixture, kept_shares = scratch(3), scratch(3)
    lowest = kept_cost = square = math.inf
    damping, haste = 0.0, 1.0
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = clutter_density(variance, wrong, spread)
        cost = linearize(pairs, prior, R, t, mixture, clutter, gives_way, normal, shares)
        cost += count * mixture_cost(variance, wrong)
        unusual = _unusual(mixture[2])
        # EM with unbiased variance may climb a little; a step that climbs more has gone astray.
        if cost + unusual > lowest + 0.5:
            copy(kept_R, R)
            copy(kept_t, t)
            copy(kept, normal)
            copy(kept_mixture, mixture)
            # Either the noise or the pose went too far: the noise first.
            damping = greater(100.0 * damping, 1e-2) if haste == 0.0 else damping
            haste = 0.0
        else:
            lowest, kept_cost = cost + unusual, cost
            copy(R, kept_R)
            copy(t, kept_t)
            copy(normal, kept)
            copy(mixture, kept_mixture)
            copy(shares, kept_shares)
            damping *= 0.1
            square = normal[5, 5] * variance / greater(shares[0] - 5.0, 1.0)
        update_mixture(square, kept_shares, float(count), min_variance, haste, mixture)
        while not solve_five_spd(normal, damping, x) and damping < 1e6:
            damping = greater(10.0 * damping, 1e-9)
        if not damping < 1e6:
            break
        decrease, size2 = promise(normal, x)
        settled = abs(mixture[0] - variance) < greater(0.01, precision) * variance
        if settled and decrease < precision:
            break
        take_step(R, t, x, size2)
    # The last step was not judged: the pose before it was.
    copy(kept_R, R)
    copy(kept_t, t)
    copy(kept, normal)
    return kept_cost


@formula
def _seen(
    pairs: np.ndarray, at: int, R: Matrix, t: Vector, precision: float, poor: float, prior: float
) -> tuple[float, float, float]:
    """Residual and parallax of a match, both for unit noise, and the sum of its `densities`."""
    residual = sampson(pairs, at, R, t)
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    variance = parallax_variance(pairs, at, R, m, t)
    good, fair, bad = densities(pairs, at, R, t, residual, precision, poor, prior)
    return residual, flow / root(variance + 1e-300), good + fair + bad


@kernel
def explain(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    residual: np.ndarray,
    parallax: np.ndarray,
    right: np.ndarray,
) -> None:
    """What a pose makes of each match.

    ``residual`` receives the Sampson residual, ``parallax`` the signed shift towards the direction
    along the epipolar line in units of its own noise, both for unit noise, and ``right`` the
    probability of being right.
    """
    turn, towards = matrix(R), vector(t)
    precision, poor = 1.0 / mixture[0], mixture[2]
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, i = panel * PANEL + lane, panel * LANES + lane
            residual[i], parallax[i], density = _seen(
                pairs, at, turn, towards, precision, poor, prior[i]
            )
            right[i] = density / (density + clutter)
