"""How far off matches are: good, poor, wrong, or on the wrong side; and EM of it.

A match is good, with a normal residual of variance ``variance``; or poor, with `TAIL_RATIO` times its
sigma; or wrong, and anywhere in a strip of half-width ``half_width`` about the epipolar line (all in
units of the noise). Of the poor ones, as large a share is poorer still, with `TAIL_RATIO` times their
sigma; and where there is a ``long_tail``, of these again. Errors of real matches go on like this, but a
search that allowed for it would take more wrong minima for right ones with noise. Of the wrong
matches some are repeated, one window taken for the next, and lie about the line (a Cauchy
distribution). Were they taken to lie anywhere, a pose that goes between them and the right ones,
with more noise, would look likelier than the right one. The shares of poor matches among the right
ones, of wrong ones among all, and of repeated ones among these are estimated along, so that normal
noise is treated as such and heavy tails lose only what they must.

A right match flows towards the direction. Noise can make a far one retreat; beyond `CHEIRALITY_SIGMA` the
density of right matches falls off, `CHEIRALITY_WEIGHT` than noise. Up to there it is flat, for rotation can
imitate parallax, and any slope would pull at the rotation; and from there it falls off smoothly: at
a kink a pose would be held, and no step of Gauss-Newton ends there.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.epipolar import flow_along, parallax_variance
from farpoint._kernels.exponential import exp_and_roots
from farpoint._kernels.pairs import ray0, ray1
from farpoint._kernels.vectors import rotate

Clutter = tuple[float, float, float]
# Of a match that is good, poor, poorer, or poorer still.
Densities = tuple[float, float, float, float]

__all__ = [
    "CHEIRALITY_SIGMA",
    "CHEIRALITY_WEIGHT",
    "LONG_TAIL",
    "REPEATED_WIDTH_RATIO",
    "SHORT_TAIL",
    "TAIL_RATIO",
    "Densities",
    "cheirality_penalty",
    "clutter_at",
    "clutter_of",
    "densities",
    "densities_of",
    "mean_variance",
    "mixture_cost",
    "repeated_share",
    "share_prior_cost",
    "sum_of",
    "tail_steps_of",
    "tail_trials_of",
    "update_mixture",
    "weight2_of",
    "weight_of",
]

# Whether errors have a ``long_tail``.
LONG_TAIL, SHORT_TAIL = 1.0, 0.0
# Sigma of a poor match over that of a good one.
TAIL_RATIO = math.sqrt(8.0)
# Share of poor matches among the right ones, and of repeated ones among the wrong ones, that is
# usual, with the weight of so many: among few, chance alone makes some look like it, and the others
# better than they are.
PRIOR_SHARE = 0.01
PRIOR_WEIGHT = 20.0
# How much farther than EM a step of the mixture goes, by the share of poor matches, and at most.
OVER_RELAXATION = 3.0
MAX_OVER_RELAXATION = 0.7
# Retreat along its epipolar line that noise can cause of a far point, in sigma; and by how much
# more steeply than noise the density falls off beyond: at 8.5 sigma it is what noise makes of it.
CHEIRALITY_SIGMA = 2.5
CHEIRALITY_WEIGHT = 2.0
# Half of the repeated matches are off by less than this part of the spread.
REPEATED_WIDTH_RATIO = 32.0


@inlined_kernel
def clutter_of(mixture: np.ndarray, half_width: float) -> Clutter:
    """Density of wrong matches over that of good ones at r = 0.

    Of those anywhere; of repeated ones, at r = 0; and one over the square of the r at which that is
    half as much.
    """
    variance, outlier_share, repeated = mixture[0], mixture[1], mixture[3]
    density = (
        outlier_share
        / (1.0 - outlier_share)
        * math.sqrt(2.0 * math.pi * variance)
        / (2.0 * half_width)
    )
    over = REPEATED_WIDTH_RATIO / half_width
    about = density * repeated * (2.0 / math.pi * REPEATED_WIDTH_RATIO)
    return density * (1.0 - repeated), about, over * over


@inlined_kernel
def clutter_at(clutter: Clutter, residual: float) -> tuple[float, float]:
    """Density of wrong matches so far off, and of the repeated ones among them."""
    anywhere, about, over2 = clutter
    near = about / (1.0 + over2 * residual * residual)
    return anywhere + near, near


@kernel
def mean_variance(variance: float, tail_share: float) -> float:
    """Of right matches, good and poor."""
    core, eightfold = 1.0 - tail_share, tail_share * TAIL_RATIO * TAIL_RATIO
    return variance * (core + eightfold * (core + eightfold * (core + eightfold)))


@step_kernel
def share_prior_cost(share: float) -> float:
    """Cost of a share of poor or of repeated matches that is not the usual one."""
    return -PRIOR_WEIGHT * (
        PRIOR_SHARE * math.log(share) + (1.0 - PRIOR_SHARE) * math.log(1.0 - share)
    )


@step_kernel
def repeated_share(repeated: float, outlier_share: float) -> float:
    """Step of EM of the share of repeated matches, from their and the wrong ones' numbers."""
    return (repeated + PRIOR_SHARE * PRIOR_WEIGHT) / (outlier_share + PRIOR_WEIGHT)


@step_kernel
def mixture_cost(variance: float, outlier_share: float) -> float:
    """What each match adds to the cost by the noise alone."""
    return 0.5 * math.log(variance) - math.log(1.0 - outlier_share)


@inlined_kernel
def densities(
    pairs: np.ndarray,
    at: int,
    R: tuple,
    t: tuple,
    residual: float,
    precision: float,
    tail_share: float,
    prior: float,
    long_tail: float,
) -> Densities:
    """Densities of the match at this address, over a good one's at 0."""
    penalty = cheirality_penalty(pairs, at, R, t, precision)
    return densities_of(
        residual * residual * precision + penalty,
        tail_share,
        tail_share / TAIL_RATIO,
        prior,
        long_tail,
    )


@inlined_kernel
def densities_of(
    square: float, tail_share: float, again: float, prior: float, long_tail: float
) -> Densities:
    """Densities so many squared sigma off, each step of the tails ``again`` times as high.

    Which is the share of ``tail_share`` ones over the `TAIL_RATIO` by which a step is wider, in one dimension;
    over its square in two.
    """
    core, tail1, tail2, tail3 = exp_and_roots(0.5 * square)
    once, twice = prior * (1.0 - tail_share), prior * again * again
    return (
        once * core,
        once * again * tail1,
        twice * (1.0 - long_tail * tail_share) * tail2,
        twice * long_tail * again * tail3,
    )


@inlined_kernel
def cheirality_penalty(pairs: np.ndarray, at: int, R: tuple, t: tuple, precision: float) -> float:
    """How much farther away from the direction a match lies than noise may bring it, squared.

    In units of the variance with which the density falls off.
    """
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    shift = flow * math.sqrt(precision / (parallax_variance(pairs, at, R, m, t) + 1e-300))
    beyond = min(shift + CHEIRALITY_SIGMA, 0.0)
    return CHEIRALITY_WEIGHT * beyond * beyond


@inlined_kernel
def sum_of(each: Densities) -> float:
    core, tail1, tail2, tail3 = each
    return core + tail1 + tail2 + tail3


@inlined_kernel
def tail_steps_of(each: Densities) -> float:
    """Sum of the densities, each times how often the match is poorer."""
    _, tail1, tail2, tail3 = each
    return tail1 + 2.0 * tail2 + 3.0 * tail3


@inlined_kernel
def tail_trials_of(each: Densities, long_tail: float) -> float:
    """Sum of the densities, each times how often the match could have been poorer."""
    core, tail1, tail2, tail3 = each
    return core + 2.0 * tail1 + (2.0 + long_tail) * tail2 + 3.0 * tail3


@inlined_kernel
def weight_of(each: Densities) -> float:
    """Sum of the densities, each over its variance in units of a good one's."""
    core, tail1, tail2, tail3 = each
    return core + tail1 * 0.125 + tail2 * 0.015625 + tail3 * 0.001953125


@inlined_kernel
def weight2_of(each: Densities) -> float:
    """As `weight_of`, each over the square of its variance."""
    core, tail1, tail2, tail3 = each
    return weight_of((core, tail1 * 0.125, tail2 * 0.015625, tail3 * 0.001953125))


@inlined_kernel
def update_mixture(
    square: float,
    shares: np.ndarray,
    count: float,
    minimum: float,
    over_relaxed: float,
    mixture: np.ndarray,
) -> None:
    """Step of EM of variance, share of wrong and share of poor matches, from weighted sums.

    Of the right matches some are poor, and of these as large a share poorer still: ``shares`` has
    the number of right ones, how often these are poorer, and how often they could have been. With a
    ``over_relaxed`` of 1 it goes farther than EM does, with 0 it does not.
    """
    total, steps, trials = shares[0], shares[1], shares[2]
    share = (steps + PRIOR_SHARE * PRIOR_WEIGHT) / (trials + PRIOR_WEIGHT)
    # EM goes the right way, and the more slowly the heavier the tails: farther that way helps.
    over_relaxation = over_relaxed * min(OVER_RELAXATION * mixture[2], MAX_OVER_RELAXATION)
    change = min(max(over_relaxation * (square / mixture[0] - 1.0), -0.5), 1.0)
    mixture[0] = max((1.0 + change) * square, minimum)
    mixture[1] = min(max(1.0 - total / count, 0.005), 0.95)
    mixture[2] = min(max(share + over_relaxation * (share - mixture[2]), 0.5 * share), 0.5)
