"""Mixture density of a residual, for inliers with a heavy tail and outliers, and EM of the mixture.

The residual of an inlier has a normal distribution with the variance ``variance`` (the core). With
the probability ``tail_share`` the sigma of an inlier is `TAIL_RATIO` times as large. Of these
inliers, a share ``tail_share`` has a sigma that is `TAIL_RATIO` times larger again, and with a
``long_tail`` a share ``tail_share`` of the latter has a sigma that is once more `TAIL_RATIO` times
larger. The density of the k-th component is ``N(r; 0, 8^k variance)``, k = 0 to 3. The search uses
the short tail, k <= 2, because with a longer tail more wrong motions are as likely as the right
motion.

An outlier lies anywhere in a strip around the epipolar line, whose half-width is ``half_width`` in
the unit of the noise sigma. A share of the outliers is repeated structure: the match connects two
neighbouring copies of a structure. The residuals of these outliers have a Cauchy distribution
around 0. If all outliers had a uniform distribution, a compromise between the right motion and the
motion of the repeated structure, with a larger variance, would be likelier than the right motion.
EM estimates three shares: of the tail among inliers, of outliers among all matches, and of repeated
structure among outliers.

Soft cheirality: an inlier flows towards the direction of translation, but noise can reverse the
flow of a far point. If the flow is reversed by s sigma and s exceeds c = `CHEIRALITY_SIGMA`, the
density of the core has the factor ``exp(-w (s - c)^2 / 2)`` with w = `CHEIRALITY_WEIGHT`. The k-th
component of the tail has the same factor to the power ``8^-k``. For any other flow, the density
does not depend on the flow: a slope of the density would bias the rotation, because a rotation
changes the parallax of all matches. The factor decreases smoothly, so that Gauss-Newton converges.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    CHEIRALITY_SIGMA,
    CHEIRALITY_WEIGHT,
    MAX_OVER_RELAXATION,
    OVER_RELAXATION,
    PRIOR_SHARE,
    PRIOR_WEIGHT,
    REPEATED_WIDTH_RATIO,
    TAIL_RATIO,
)
from farpoint._kernels.epipolar import flow_along, parallax_variance
from farpoint._kernels.exponential import exp_and_roots
from farpoint._kernels.pairs import ray0, ray1
from farpoint._kernels.vectors import rotate

Clutter = tuple[float, float, float]
# Densities of the core and of the three components of the tail.
Densities = tuple[float, float, float, float]

__all__ = [
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


@inlined_kernel
def clutter_of(mixture: np.ndarray, half_width: float) -> Clutter:
    """Density of outliers times their odds, divided by the density of the core at r = 0.

    The odds are ``outlier_share / (1 - outlier_share)``. The function returns the uniform part, the
    part of repeated structure at r = 0, and the inverse square of the scale of the Cauchy
    distribution of repeated structure.
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
    """`clutter_of` at a ``residual``: of all outliers, and of repeated structure alone."""
    anywhere, about, over2 = clutter
    near = about / (1.0 + over2 * residual * residual)
    return anywhere + near, near


@kernel
def mean_variance(variance: float, tail_share: float) -> float:
    """Mean variance of inliers over core and tail."""
    core, eightfold = 1.0 - tail_share, tail_share * TAIL_RATIO * TAIL_RATIO
    return variance * (core + eightfold * (core + eightfold * (core + eightfold)))


@step_kernel
def share_prior_cost(share: float) -> float:
    """Negative log density of the Beta prior of a share, up to a constant."""
    return -PRIOR_WEIGHT * (
        PRIOR_SHARE * math.log(share) + (1.0 - PRIOR_SHARE) * math.log(1.0 - share)
    )


@step_kernel
def repeated_share(repeated: float, outlier_share: float) -> float:
    """EM step of the share of repeated structure among outliers.

    The arguments are the expected numbers of repeated-structure outliers and of all outliers.
    """
    return (repeated + PRIOR_SHARE * PRIOR_WEIGHT) / (outlier_share + PRIOR_WEIGHT)


@step_kernel
def mixture_cost(variance: float, outlier_share: float) -> float:
    """Normalisation of the cost per match, ``log(sigma) - log(1 - outlier_share)``."""
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
    """`densities_of` the match at the address ``at``, given its ``residual``."""
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
    """Densities of the core and of the tail, divided by the density of the core at a residual of 0.

    ``square`` is the squared residual divided by the variance of the core, plus a cheirality
    penalty. All densities are multiplied by the ``prior`` of the match, and each component by its
    probability. The height of each component of the tail is ``again`` times that of the previous
    component. ``again`` is ``tail_share / TAIL_RATIO`` in one dimension,
    ``tail_share / TAIL_RATIO^2`` in two.
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
    """Soft cheirality penalty ``2 min(s + 2.5, 0)^2``, where s is the parallax in sigma.

    The penalty is added to the squared residual divided by the variance.
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
    """Sum of the densities of all components, each multiplied by the component's index k."""
    _, tail1, tail2, tail3 = each
    return tail1 + 2.0 * tail2 + 3.0 * tail3


@inlined_kernel
def tail_trials_of(each: Densities, long_tail: float) -> float:
    """Sum of the densities of all components, each multiplied by the number of trials of the tail.

    In each trial, an inlier moves on to the next component of the tail with the probability
    ``tail_share``. An inlier of component k has made k + 1 trials, but at most 3 with the long
    tail, and at most 2 with the short tail.
    """
    core, tail1, tail2, tail3 = each
    return core + 2.0 * tail1 + (2.0 + long_tail) * tail2 + 3.0 * tail3


@inlined_kernel
def weight_of(each: Densities) -> float:
    """Sum of the densities of all components, each divided by the component's variance.

    The unit of the variance is the variance of the core.
    """
    core, tail1, tail2, tail3 = each
    return core + tail1 * 0.125 + tail2 * 0.015625 + tail3 * 0.001953125


@inlined_kernel
def weight2_of(each: Densities) -> float:
    """Sum of the densities of all components, each divided by the component's squared variance."""
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
    """EM step of variance, outlier share and tail share.

    ``square`` is the weighted mean square of the residuals. ``shares`` holds the expected number of
    inliers, of tail steps and of trials. ``count`` is the number of matches, and ``minimum`` is the
    lower bound of the variance. With ``over_relaxed`` 1 the step is over-relaxed, and with 0 the
    step is that of plain EM.
    """
    total, steps, trials = shares[0], shares[1], shares[2]
    share = (steps + PRIOR_SHARE * PRIOR_WEIGHT) / (trials + PRIOR_WEIGHT)
    # EM converges linearly, and more slowly with a heavier tail; over-relaxation compensates for
    # that.
    over_relaxation = over_relaxed * min(OVER_RELAXATION * mixture[2], MAX_OVER_RELAXATION)
    change = min(max(over_relaxation * (square / mixture[0] - 1.0), -0.5), 1.0)
    mixture[0] = max((1.0 + change) * square, minimum)
    mixture[1] = min(max(1.0 - total / count, 0.005), 0.95)
    mixture[2] = min(max(share + over_relaxation * (share - mixture[2]), 0.5 * share), 0.5)
