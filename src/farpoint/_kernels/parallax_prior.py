"""Empirical-Bayes prior of the parallax: the density of the parallax of the other inliers."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inner_kernel, step_kernel
from farpoint._kernels.constants import (
    FIRST_RANK,
    GATE_SIGMA,
    MIN_PARALLAX_PRIOR,
    MIN_PRIOR_TAIL,
    PARALLAX_BIN,
    PARALLAX_BINS,
    PARALLAX_FALSE_ALARM,
    PRIOR_FALL_OFF,
    UNIFORM_COUNT,
)
from farpoint._kernels.exponential import lane_log

__all__ = ["fit_parallax_prior", "kth_largest"]


@inner_kernel
def kth_largest(values: np.ndarray, k: int) -> float:
    """The ``k``-th largest of non-negative values, by bisection to 1e-6 of the largest value."""
    low, high = 0.0, 0.0
    for i in range(values.size):
        high = max(high, values[i])
    least = 1e-6 * high
    while high - low > least:
        middle = 0.5 * (low + high)
        above = 0
        for i in range(values.size):
            above += 1 if values[i] > middle else 0
        if above >= k:
            low = middle
        else:
            high = middle
    return high


@inner_kernel
def fit_parallax_prior(
    parallax: np.ndarray,
    inlier: np.ndarray,
    count: int,
    sigma: float,
    half_width: float,
    prior: np.ndarray,
) -> float:
    """Prior of each match by its parallax along the epipolar line; returns the end of the prior.

    The prior of a match is the density of the parallax of the other inliers, divided by the density
    of outliers, which is uniform over a length ``2 half_width`` of the epipolar line. The inlier
    probabilities ``inlier`` were computed without a prior.

    An outlier that happens to lie on its epipolar line agrees with the motion, and one outlier with
    a long flow would outweigh all inliers. Two outliers determine a direction, and up to k more
    outliers lie by chance on the epipolar lines of this direction (`_chance_count`). A parallax is
    therefore supported only if the number of inliers with at least this parallax exceeds the
    smaller of ``k + 2`` and the number of all outliers.

    s1 and s2 are parallaxes divided by ``sigma``. s1 is the largest supported parallax, which K
    inliers reach or exceed, but at least 3. s2 is the parallax that 2 K inliers reach or exceed. D
    is ``max(((s1 / s2)^2 - 1) s1, 0.1 s1, 3)``, at most s1; beyond s1 the density of inliers
    decreases over about this distance. Up to ``s1 + D`` the prior is a histogram of the other
    inliers plus a uniform pseudo-count. Beyond ``s1 + D`` the prior has a Gaussian fall-off with
    the standard deviation `PRIOR_FALL_OFF` times D. The function returns the parallax, in the unit
    of ``parallax``, at `GATE_SIGMA` standard deviations beyond ``s1 + D``. If no parallax is
    supported, the prior is 1 and the returned end is infinite.
    """
    sizes = np.empty(count)
    inliers = _inlier_parallaxes(parallax, inlier, sigma, sizes)
    outliers = count - inliers
    # Expected number of outliers that lie on the epipolar lines by chance and flow towards the
    # direction. The factor 0.5 is the share of the outliers on the lines that flow towards the
    # direction. At most all outliers lie on the lines.
    by_chance = 0.5 * outliers * GATE_SIGMA * sigma / half_width
    captured = min(outliers, 2 + _chance_count(by_chance, 0.5 * outliers * (outliers - 1)))
    if inliers <= captured:
        for i in range(count):
            prior[i] = 1.0
        return math.inf
    last, tail = _reach(sizes, captured)
    ranks, bins = np.empty(count), np.empty(PARALLAX_BINS)
    total = _count(parallax, inlier, sizes, sigma, ranks, bins)
    for i in range(count):
        p, own = parallax[i] / sigma, inlier[i] if sizes[i] >= 0.0 else 0.0
        there = _at(bins, ranks[i], own) * _slope(p)
        density = (UNIFORM_COUNT / (last + tail + GATE_SIGMA) + there) / (
            UNIFORM_COUNT + total - own
        )
        beyond = (p - last) / tail - 1.0
        fading = math.exp(-0.5 * (beyond / PRIOR_FALL_OFF) ** 2) if beyond > 0.0 else 1.0
        prior[i] = max(2.0 * half_width / sigma * density * fading, MIN_PARALLAX_PRIOR)
    return (last + (1.0 + GATE_SIGMA * PRIOR_FALL_OFF) * tail) * sigma


@step_kernel
def _inlier_parallaxes(
    parallax: np.ndarray, inlier: np.ndarray, sigma: float, sizes: np.ndarray
) -> int:
    """Write the absolute parallax of each inlier in sigma, and -1 for other matches, to ``sizes``.

    An inlier with a parallax of -`GATE_SIGMA` sigma or less counts as another match. The function
    returns the number of inliers.
    """
    inliers = 0
    for i in range(sizes.size):
        p = parallax[i] / sigma
        belongs = inlier[i] > 0.5 and p > -GATE_SIGMA
        sizes[i] = abs(p) if belongs else -1.0
        inliers += 1 if belongs else 0
    return inliers


@step_kernel
def _reach(sizes: np.ndarray, captured: int) -> tuple[float, float]:
    """Largest supported parallax s1, and D, in sigma; see `fit_parallax_prior`."""
    last = max(kth_largest(sizes, captured + 1), GATE_SIGMA)
    nearer = max(kth_largest(sizes, 2 * (captured + 1)) / last, math.sqrt(0.5))
    return last, max(max(1.0 / (nearer * nearer) - 1.0, MIN_PRIOR_TAIL) * last, GATE_SIGMA)


@step_kernel
def _chance_count(expected: float, directions: float) -> int:
    """Upper bound of the number of outliers that lie on the lines of one direction by chance.

    The probability of more outliers is at most `PARALLAX_FALSE_ALARM`. This probability is the tail
    of the Poisson distribution with mean ``expected``, bounded by a geometric series, times the
    number of ``directions``.
    """
    k, chance = 0, math.exp(-expected)
    while (
        k <= expected
        or directions * chance * (k + 1.0) / (k + 1.0 - expected) > PARALLAX_FALSE_ALARM
    ):
        k += 1
        chance *= expected / k
    return k - 1 if k > 0 else 0


@step_kernel
def _count(
    parallax: np.ndarray,
    inlier: np.ndarray,
    sizes: np.ndarray,
    sigma: float,
    ranks: np.ndarray,
    bins: np.ndarray,
) -> float:
    """Histogram of the parallax of inliers; returns the total of the histogram.

    Each inlier is divided between the two nearest ``bins`` in proportion. Matches with a negative
    size are left out.
    """
    clear(bins)
    total = 0.0
    for i in range(ranks.size):
        ranks[i] = _rank(parallax[i] / sigma)
    for i in range(ranks.size):
        if sizes[i] >= 0.0:
            k = int(ranks[i])
            share = ranks[i] - k
            bins[k] += inlier[i] * (1.0 - share)
            bins[k + 1] += inlier[i] * share
            total += inlier[i]
    return total


@inner_kernel
def _at(bins: np.ndarray, rank: float, own: float) -> float:
    """Interpolated histogram at a rank, without the contribution of the match itself."""
    k = int(rank)
    share = rank - k
    others = (1.0 - share) * bins[k] + share * bins[k + 1]
    return others - own * ((1.0 - share) * (1.0 - share) + share * share)


@step_kernel
def _rank(p: float) -> float:
    """Bin of a parallax in sigma: equal steps within the noise, equal ratios beyond the noise.

    The rank is an inverse hyperbolic sine (Burbidge, Magee and Robb, J. Am. Stat. Assoc. 83, 1988,
    DOI 10.1080/01621459.1988.10478575), and is 0 for a parallax of ``-GATE_SIGMA`` or less.
    """
    u = max(p / GATE_SIGMA, -1.0)
    rank = (lane_log(u + math.sqrt(u * u + 1.0)) - FIRST_RANK) / PARALLAX_BIN
    return min(max(rank, 0.0), PARALLAX_BINS - 1.5)


@step_kernel
def _slope(p: float) -> float:
    """Derivative of `_rank` by the parallax."""
    return 1.0 / (PARALLAX_BIN * math.sqrt(p * p + GATE_SIGMA * GATE_SIGMA))
