"""Where along its epipolar line a right match may lie, learnt from the others."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inner_kernel, step_kernel
from farpoint._kernels.exponential import lane_log

__all__ = ["BAND_SIGMA", "END", "FALL_OFF", "MIN_TAIL", "fit_parallax_prior", "kth_largest"]

# Half-width of the band in which a match agrees with its epipolar line, in sigma.
BAND_SIGMA = 3.0
# Chance that more wrong matches than are counted for it lie on the lines of any direction.
FALSE_ALARM_RATE = 0.05
# How far beyond the last match that others vouch for one may lie at least, of the way to that one,
# and in what share of that distance it fades out.
MIN_TAIL = 0.1
FALL_OFF = 0.3
# How often it fades until nothing is left.
END = 3.0
# Bins of parallax, of this width where it is told by its `_rank`: a factor of 1.5 beyond the noise.
BINS = 64
BIN = 0.4
# Right matches, beside those that are seen, that lie anywhere up to there: half a one, of which no
# more is known (Krichevsky and Trofimov, IEEE Trans. Inf. Theory 27, 1981,
# DOI 10.1109/TIT.1981.1056331).
UNIFORM_COUNT = 0.5
# An implausible match is not left out, which would cost nothing: it is all the surer wrong.
MIN_PRIOR = 1e-30
# Where the first bin begins: at the end of the band.
FIRST = math.asinh(-1.0)


@inner_kernel
def kth_largest(values: np.ndarray, k: int) -> float:
    """The ``k``-th largest of non-negative values, to a millionth of the largest."""
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
    """Prior of each match from where it lies along its epipolar line; the parallax that ends it.

    A wrong match lies anywhere in the image, a right one where others lie, and not far beyond. The
    prior is the density of right matches there over that of wrong ones, which lie anywhere in the
    strip ``2 half_width``.

    A wrong match far along the line outweighs all right ones. Two of them fix a direction: as many
    as lie on the lines of the best of these by chance, and the two, may not vouch for one another.
    How far beyond the last of the others one may lie, up to twice as far, tells by how much they
    have thinned out there, from the last but as many: they may end at once. Up to there the others
    say where right matches are many, and where few; no match says so of itself.

    Who is ``inlier`` is asked without a prior: of those that are left when some were implausible, as
    many again would not vouch for one another.
    """
    sizes = np.empty(count)
    inliers = _inlier_parallaxes(parallax, inlier, sigma, sizes)
    outliers = count - inliers
    # Where no match is off the lines, none is on one by chance. Half of those flow backwards.
    by_chance = 0.5 * outliers * BAND_SIGMA * sigma / half_width
    captured = min(outliers, 2 + _chance_count(by_chance, 0.5 * outliers * (outliers - 1)))
    if inliers <= captured:
        for i in range(count):
            prior[i] = 1.0
        return math.inf
    last, tail = _reach(sizes, captured)
    ranks, bins = np.empty(count), np.empty(BINS)
    total = _count(parallax, inlier, sizes, sigma, ranks, bins)
    for i in range(count):
        p, own = parallax[i] / sigma, inlier[i] if sizes[i] >= 0.0 else 0.0
        there = _at(bins, ranks[i], own) * _slope(p)
        density = (UNIFORM_COUNT / (last + tail + BAND_SIGMA) + there) / (
            UNIFORM_COUNT + total - own
        )
        beyond = (p - last) / tail - 1.0
        fading = math.exp(-0.5 * (beyond / FALL_OFF) ** 2) if beyond > 0.0 else 1.0
        prior[i] = max(2.0 * half_width / sigma * density * fading, MIN_PRIOR)
    return (last + (1.0 + END * FALL_OFF) * tail) * sigma


@step_kernel
def _inlier_parallaxes(
    parallax: np.ndarray, inlier: np.ndarray, sigma: float, sizes: np.ndarray
) -> int:
    """Parallax of right matches, in sigma, -1 of others; how many are right."""
    inliers = 0
    for i in range(sizes.size):
        p = parallax[i] / sigma
        belongs = inlier[i] > 0.5 and p > -BAND_SIGMA
        sizes[i] = abs(p) if belongs else -1.0
        inliers += 1 if belongs else 0
    return inliers


@step_kernel
def _reach(sizes: np.ndarray, captured: int) -> tuple[float, float]:
    """The last match that the others vouch for, and how far beyond one may lie, in sigma."""
    last = max(kth_largest(sizes, captured + 1), BAND_SIGMA)
    nearer = max(kth_largest(sizes, 2 * (captured + 1)) / last, math.sqrt(0.5))
    return last, max(max(1.0 / (nearer * nearer) - 1.0, MIN_TAIL) * last, BAND_SIGMA)


@step_kernel
def _chance_count(expected: float, directions: float) -> int:
    """Most matches that, where so many are expected of each direction, any of them may have.

    With a chance of `FALSE_ALARM_RATE`, for all directions together, that it is more: the tail of Poisson's
    distribution, bounded by a geometric series.
    """
    k, chance = 0, math.exp(-expected)
    while (
        k <= expected or directions * chance * (k + 1.0) / (k + 1.0 - expected) > FALSE_ALARM_RATE
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
    """Count the right matches, by their parallax, in the two ``bins`` about each; all of them.

    Those of a negative size are none.
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
    """Matches in a bin about this rank, without that one which counts as ``own``."""
    k = int(rank)
    share = rank - k
    others = (1.0 - share) * bins[k] + share * bins[k + 1]
    return others - own * ((1.0 - share) * (1.0 - share) + share * share)


@step_kernel
def _rank(p: float) -> float:
    """Bin of a parallax, in sigma: even steps within the noise, equal ratios beyond.

    The inverse hyperbolic sine (Burbidge, Magee and Robb, J. Am. Stat. Assoc. 83, 1988,
    DOI 10.1080/01621459.1988.10478575) from that of the end of the band on.
    """
    u = max(p / BAND_SIGMA, -1.0)
    rank = (lane_log(u + math.sqrt(u * u + 1.0)) - FIRST) / BIN
    return min(max(rank, 0.0), BINS - 1.5)


@step_kernel
def _slope(p: float) -> float:
    """Derivative of `_rank`."""
    return 1.0 / (BIN * math.sqrt(p * p + BAND_SIGMA * BAND_SIGMA))
