"""How far off matches are: good, poor, wrong, or on the wrong side; and EM of it.

A match is good, with a normal residual of variance ``variance``; or poor, with `POOR` times its
sigma; or wrong, and anywhere in a strip of half-width ``spread`` about the epipolar line (all in
units of the noise). Of the poor ones, as large a share is poorer still, with `POOR` times their
sigma; and where there is a ``tail``, of these again. Errors of real matches go on like this, but a
search that allowed for it would take more wrong minima for right ones with noise. Of the wrong
matches some are repeated, one window taken for the next, and lie about the line (a Cauchy
distribution). Were they taken to lie anywhere, a pose that goes between them and the right ones,
with more noise, would look likelier than the right one. The shares of poor matches among the right
ones, of wrong ones among all, and of repeated ones among these are estimated along, so that normal
noise is treated as such and heavy tails lose only what they must.

A right match flows towards the direction. Noise can make a far one retreat; beyond `FAR_SIGMA` the
density of right matches falls off, `STEEPER` than noise. Up to there it is flat, for rotation can
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
    "FAR_SIGMA",
    "NO_TAIL",
    "POOR",
    "REPEATED_WITHIN",
    "STEEPER",
    "TAIL",
    "Densities",
    "clutter_at",
    "clutter_of",
    "densities",
    "densities_of",
    "mean_variance",
    "mixture_cost",
    "repeated_share",
    "retreat2",
    "steps_of",
    "sum_of",
    "trials_of",
    "unusual",
    "update_mixture",
    "weight2_of",
    "weight_of",
]

# Whether errors have a ``tail``.
TAIL, NO_TAIL = 1.0, 0.0
# Sigma of a poor match over that of a good one.
POOR = math.sqrt(8.0)
# Share of poor matches among the right ones, and of repeated ones among the wrong ones, that is
# usual, with the weight of so many: among few, chance alone makes some look like it, and the others
# better than they are.
FEW = 0.01
USUAL = 20.0
# How much farther than EM a step of the mixture goes, by the share of poor matches, and at most.
FARTHER = 3.0
MOST_FARTHER = 0.7
# Retreat along its epipolar line that noise can cause of a far point, in sigma; and by how much
# more steeply than noise the density falls off beyond: at 8.5 sigma it is what noise makes of it.
FAR_SIGMA = 2.5
STEEPER = 2.0
# Half of the repeated matches are off by less than this part of the spread.
REPEATED_WITHIN = 32.0


@inlined_kernel
def clutter_of(mixture: np.ndarray, spread: float) -> Clutter:
    """Density of wrong matches over that of good ones at r = 0.

    Of those anywhere; of repeated ones, at r = 0; and one over the square of the r at which that is
    half as much.
    """
    variance, wrong, repeated = mixture[0], mixture[1], mixture[3]
    density = wrong / (1.0 - wrong) * math.sqrt(2.0 * math.pi * variance) / (2.0 * spread)
    over = REPEATED_WITHIN / spread
    about = density * repeated * (2.0 / math.pi * REPEATED_WITHIN)
    return density * (1.0 - repeated), about, over * over


@inlined_kernel
def clutter_at(clutter: Clutter, residual: float) -> tuple[float, float]:
    """Density of wrong matches so far off, and of the repeated ones among them."""
    anywhere, about, over2 = clutter
    near = about / (1.0 + over2 * residual * residual)
    return anywhere + near, near


@kernel
def mean_variance(variance: float, poor: float) -> float:
    """Of right matches, good and poor."""
    good, eightfold = 1.0 - poor, poor * POOR * POOR
    return variance * (good + eightfold * (good + eightfold * (good + eightfold)))


@step_kernel
def unusual(share: float) -> float:
    """Cost of a share of poor or of repeated matches that is not the usual one."""
    return -USUAL * (FEW * math.log(share) + (1.0 - FEW) * math.log(1.0 - share))


@step_kernel
def repeated_share(repeated: float, wrong: float) -> float:
    """Step of EM of the share of repeated matches, from their and the wrong ones' numbers."""
    return (repeated + FEW * USUAL) / (wrong + USUAL)


@step_kernel
def mixture_cost(variance: float, wrong: float) -> float:
    """What each match adds to the cost by the noise alone."""
    return 0.5 * math.log(variance) - math.log(1.0 - wrong)


@inlined_kernel
def densities(
    pairs: np.ndarray,
    at: int,
    R: tuple,
    t: tuple,
    residual: float,
    precision: float,
    poor: float,
    prior: float,
    tail: float,
) -> Densities:
    """Densities of the match at this address, over a good one's at 0."""
    retreat = retreat2(pairs, at, R, t, precision)
    return densities_of(residual * residual * precision + retreat, poor, poor / POOR, prior, tail)


@inlined_kernel
def densities_of(square: float, poor: float, again: float, prior: float, tail: float) -> Densities:
    """Densities so many squared sigma off, each step of the tails ``again`` times as high.

    Which is the share of ``poor`` ones over the `POOR` by which a step is wider, in one dimension;
    over its square in two.
    """
    good, fair, bad, worst = exp_and_roots(0.5 * square)
    once, twice = prior * (1.0 - poor), prior * again * again
    return (
        once * good,
        once * again * fair,
        twice * (1.0 - tail * poor) * bad,
        twice * tail * again * worst,
    )


@inlined_kernel
def retreat2(pairs: np.ndarray, at: int, R: tuple, t: tuple, precision: float) -> float:
    """How much farther away from the direction a match lies than noise may bring it, squared.

    In units of the variance with which the density falls off.
    """
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    flow, _ = flow_along(m, b, t)
    shift = flow * math.sqrt(precision / (parallax_variance(pairs, at, R, m, t) + 1e-300))
    beyond = min(shift + FAR_SIGMA, 0.0)
    return STEEPER * beyond * beyond


@inlined_kernel
def sum_of(each: Densities) -> float:
    good, fair, bad, worst = each
    return good + fair + bad + worst


@inlined_kernel
def steps_of(each: Densities) -> float:
    """Sum of the densities, each times how often the match is poorer."""
    _, fair, bad, worst = each
    return fair + 2.0 * bad + 3.0 * worst


@inlined_kernel
def trials_of(each: Densities, tail: float) -> float:
    """Sum of the densities, each times how often the match could have been poorer."""
    good, fair, bad, worst = each
    return good + 2.0 * fair + (2.0 + tail) * bad + 3.0 * worst


@inlined_kernel
def weight_of(each: Densities) -> float:
    """Sum of the densities, each over its variance in units of a good one's."""
    good, fair, bad, worst = each
    return good + fair * 0.125 + bad * 0.015625 + worst * 0.001953125


@inlined_kernel
def weight2_of(each: Densities) -> float:
    """As `weight_of`, each over the square of its variance."""
    good, fair, bad, worst = each
    return weight_of((good, fair * 0.125, bad * 0.015625, worst * 0.001953125))


@inlined_kernel
def update_mixture(
    square: float,
    shares: np.ndarray,
    count: float,
    minimum: float,
    haste: float,
    mixture: np.ndarray,
) -> None:
    """Step of EM of variance, share of wrong and share of poor matches, from weighted sums.

    Of the right matches some are poor, and of these as large a share poorer still: ``shares`` has
    the number of right ones, how often these are poorer, and how often they could have been. With a
    ``haste`` of 1 it goes farther than EM does, with 0 it does not.
    """
    total, steps, trials = shares[0], shares[1], shares[2]
    share = (steps + FEW * USUAL) / (trials + USUAL)
    # EM goes the right way, and the more slowly the heavier the tails: farther that way helps.
    farther = haste * min(FARTHER * mixture[2], MOST_FARTHER)
    change = min(max(farther * (square / mixture[0] - 1.0), -0.5), 1.0)
    mixture[0] = max((1.0 + change) * square, minimum)
    mixture[1] = min(max(1.0 - total / count, 0.005), 0.95)
    mixture[2] = min(max(share + farther * (share - mixture[2]), 0.5 * share), 0.5)
